//! Bytes, processor time and losses of JPEG and H.264, of the pictures that `city3d frames` has put into a folder:
//! `cargo bench -p city3d-web --features h264 --bench codecs -- FOLDER`.
#![allow(clippy::unwrap_used, reason = "a measurement may end where it finds something wrong")]

use city3d_render::Image;
use city3d_session::pictures::jpeg;
use city3d_web::codecs::{Picture, ViewEncoder};
use openh264::decoder::Decoder;
use openh264::formats::YUVSource;
use std::path::PathBuf;
use std::time::Duration;

/// Bytes, processor time and mean difference of an encoded picture.
type Measured = (usize, Duration, f64);

fn main() {
    let Some(folder) = std::env::args().skip(1).find(|argument| !argument.starts_with('-')) else {
        println!("no folder with pictures is named");
        return;
    };
    let images = read_images(&folder);
    assert!(!images.is_empty(), "{folder} has no PNG pictures");
    let (mut encoder, mut decoder) = (ViewEncoder::new().unwrap(), Decoder::new().unwrap());
    let (mut keys, mut deltas, mut jpegs) = (Vec::new(), Vec::new(), Vec::new());
    for (number, image) in images.iter().enumerate() {
        jpegs.push(of_jpeg(image));
        let measured = of_frame(&mut encoder, &mut decoder, image, number == 0);
        if number == 0 { keys.push(measured) } else { deltas.push(measured) }
    }
    for (name, measured) in [("JPEG", jpegs), ("H.264 key frame", keys), ("H.264 other frames", deltas)] {
        tell([images[0].width, images[0].height], name, &measured);
    }
}

/// The pictures of a folder, by their names.
fn read_images(folder: &str) -> Vec<Image> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|kind| kind == "png"));
    paths.sort();
    let read = |path: &PathBuf| image::open(path).unwrap().into_rgb8();
    paths.iter().map(read).map(of_rgb).collect()
}

fn of_rgb(read: image::RgbImage) -> Image {
    Image { width: read.width(), height: read.height(), rgb: read.into_raw() }
}

fn of_jpeg(image: &Image) -> Measured {
    let begun = processor_time();
    let encoded = jpeg(image, 80).unwrap();
    let took = processor_time() - begun;
    let seen = of_rgb(image::load_from_memory(&encoded).unwrap().into_rgb8());
    (encoded.len(), took, difference(&seen, image))
}

fn of_frame(encoder: &mut ViewEncoder, decoder: &mut Decoder, image: &Image, is_key: bool) -> Measured {
    let begun = processor_time();
    let picture = encoder.encode(image, is_key).unwrap();
    let took = processor_time() - begun;
    (picture.bytes.len(), took, difference(&decoded(decoder, &picture), image))
}

fn decoded(decoder: &mut Decoder, picture: &Picture) -> Image {
    let frame = decoder.decode(&picture.bytes).unwrap().unwrap();
    let (width, height) = frame.dimensions();
    let mut rgb = vec![0; width * height * 3];
    frame.write_rgb8(&mut rgb);
    Image { width: width as u32, height: height as u32, rgb }
}

/// Mean difference of a channel.
fn difference(a: &Image, b: &Image) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let sum: f64 = a.rgb.iter().zip(&b.rgb).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    sum / a.rgb.len() as f64
}

/// What this thread has had of a processor.
fn processor_time() -> Duration {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    Duration::from_nanos(told.split(' ').next().unwrap().parse().unwrap())
}

/// Prints the means; nothing of no pictures.
fn tell([width, height]: [u32; 2], name: &str, measured: &[Measured]) {
    let count = measured.len();
    if count == 0 {
        return;
    }
    let bytes = measured.iter().map(|(bytes, ..)| bytes).sum::<usize>() / count;
    let took = measured.iter().map(|(_, took, _)| *took).sum::<Duration>().as_secs_f64() / count as f64;
    let differ = measured.iter().map(|(.., differ)| differ).sum::<f64>() / count as f64;
    println!(
        "{width}x{height} {name}: {count} pictures, {bytes} bytes, {:.2} ms, differ by {differ:.2} of 255",
        1000.0 * took
    );
}
