//! A video of the window, or of the city in it: pictures come as they are drawn, a thread of its own encodes them, and the file has
//! its name when it is whole.

use super::unused::written;
use crate::ui::{DecimalSeparator, VideoKind, VideoRequest, VideoStatus, VideoSubject};
use city3d_render::Image;
use city3d_render::video::{FrameRate, Video, VideoError, VideoOutput};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pictures per second of the file.
const RATE: u64 = 25;
/// What is said until the file is complete.
const WRITING: &str = "The video is being written; its file is named here once it is complete";
/// Pictures that wait for the encoder at most. What finds no room is left out, and the picture before it stays longer.
const WAITING: usize = 8;

/// Records a video while the window is used.
pub(super) struct VideoRecorder {
    request: VideoRequest,
    file: PathBuf,
    extent: [u32; 2],
    /// When the first picture came: a video does not begin before it.
    begun: Option<Instant>,
    /// Simulated time of the last picture of a time-lapse.
    last_s: Option<f64>,
    /// Time of the run between the pictures so far, simulated seconds.
    spanned_s: f64,
    /// Place of the last picture in the file.
    last: Option<u64>,
    pictures: Option<SyncSender<(u64, Image)>>,
    encoder: Option<JoinHandle<Result<(), VideoError>>>,
    has_ended: Arc<AtomicBool>,
}

impl VideoRecorder {
    /// Begins a video of pictures of this size in a file; its extension tells the format.
    ///
    /// # Errors
    /// In words, where it cannot be begun: without ffmpeg, or where the file cannot be written.
    pub(super) fn begin(request: VideoRequest, file: &Path, extent: [u32; 2]) -> Result<Self, String> {
        // Chroma is stored for two by two pixels.
        let extent = extent.map(|pixels| (pixels & !1).max(2));
        let output = match file.extension() {
            Some(extension) if extension == "y4m" => VideoOutput::Y4m(file.to_owned()),
            _ => VideoOutput::Encoded(file.to_owned()),
        };
        let rate = FrameRate { numerator: RATE, denominator: 1 };
        let video = Video::create(&output, extent, rate).map_err(|error| error.to_string())?;
        let (sender, receiver) = sync_channel(WAITING);
        let has_ended = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&has_ended);
        let work = move || {
            let outcome = encode(video, extent, &receiver);
            ended.store(true, Ordering::Relaxed);
            outcome
        };
        let encoder = std::thread::Builder::new().name("video".to_owned()).spawn(work);
        let encoder = encoder.map_err(|error| format!("the video cannot be encoded: {error}"))?;
        Ok(Self {
            request,
            file: file.to_owned(),
            extent,
            begun: None,
            last_s: None,
            spanned_s: 0.0,
            last: None,
            pictures: Some(sender),
            encoder: Some(encoder),
            has_ended,
        })
    }

    /// How it does.
    pub(super) fn status(&self) -> VideoStatus {
        let length_s = self.last.map_or(0.0, |last| (last + 1) as f64 / RATE as f64);
        VideoStatus { request: self.request, length_s, spanned_s: self.spanned_s }
    }

    /// Place of the next picture, if one is due.
    fn next(&self, now: Instant, simulated_s: f64) -> Option<u64> {
        match self.request.kind {
            VideoKind::AsSeen => {
                let since = self.begun.map_or(Duration::ZERO, |begun| now.saturating_duration_since(begun));
                let place = (since.as_secs_f64() * RATE as f64) as u64;
                self.last.is_none_or(|last| place > last).then_some(place)
            }
            VideoKind::TimeLapse { every_s } => {
                let is_due = self.last_s.is_none_or(|last_s| {
                    // After a reset the time begins anew.
                    simulated_s < last_s || simulated_s - last_s >= every_s - 1e-6
                });
                is_due.then(|| self.last.map_or(0, |last| last + 1))
            }
        }
    }

    /// Whether a picture of this instant belongs into the video.
    pub(super) fn wants(&self, now: Instant, simulated_s: f64) -> bool {
        self.next(now, simulated_s).is_some()
    }

    /// When the next picture is due, though nothing changes; a time-lapse waits for the run.
    pub(super) fn next_in(&self) -> Option<Duration> {
        (self.request.kind == VideoKind::AsSeen).then(|| Duration::from_secs(1) / RATE as u32)
    }

    /// Takes a picture.
    pub(super) fn add(&mut self, image: Image, now: Instant, simulated_s: f64) {
        let Some(place) = self.next(now, simulated_s) else { return };
        let Some(pictures) = &self.pictures else { return };
        match pictures.try_send((place, image)) {
            Ok(()) => {
                self.begun = self.begun.or(Some(now));
                // After a reset the time begins anew.
                self.spanned_s += self.last_s.map_or(0.0, |last_s| (simulated_s - last_s).max(0.0));
                (self.last, self.last_s) = (Some(place), Some(simulated_s));
            }
            // The encoder is slower than the window: the next picture may find room.
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
        }
    }

    /// Whether the encoder has failed meanwhile.
    pub(super) fn has_failed(&self) -> bool {
        self.has_ended.load(Ordering::Relaxed)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// What went wrong, in words.
    pub(super) fn finish(mut self) -> Result<FinishedVideo, String> {
        let status = self.status();
        self.end().map_err(|error| error.to_string())?;
        Ok(FinishedVideo { status, file: self.file.clone() })
    }

    fn end(&mut self) -> Result<(), VideoError> {
        self.pictures = None;
        let outcome = self.encoder.take().map(JoinHandle::join);
        outcome.and_then(Result::ok).unwrap_or(Ok(()))
    }
}

/// A video that is complete.
pub(super) struct FinishedVideo {
    status: VideoStatus,
    file: PathBuf,
}

impl FinishedVideo {
    fn words(&self, decimal: DecimalSeparator) -> String {
        let [length, spanned] = [self.status.length_s, self.status.spanned_s].map(|s| decimal.fixed(s, 1));
        let what = match self.status.request.kind {
            VideoKind::AsSeen => format!("Video of {length} s"),
            VideoKind::TimeLapse { .. } => format!("Time-lapse of {length} s, of {spanned} s of the run"),
        };
        format!("{what}: {}", written(&self.file))
    }
}

impl Drop for VideoRecorder {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::warn!("{error}");
        }
    }
}

/// Writes pictures to their places: each stays until the next one.
fn encode(mut video: Video, extent: [u32; 2], pictures: &Receiver<(u64, Image)>) -> Result<(), VideoError> {
    let mut last: Option<(u64, Image)> = None;
    while let Ok((place, image)) = pictures.recv() {
        let image = fitted(image, extent);
        if let Some((before, shown)) = &last {
            for _ in *before + 1..place {
                video.add(shown)?;
            }
        }
        video.add(&image)?;
        last = Some((place, image));
    }
    video.finish().map(drop)
}

/// A picture in the size of the video, which stays when the window changes: cut, or with a black border.
fn fitted(image: Image, [width, height]: [u32; 2]) -> Image {
    if [image.width, image.height] == [width, height] {
        return image;
    }
    let mut rgb = vec![0; 3 * width as usize * height as usize];
    let row = 3 * width.min(image.width) as usize;
    let targets = rgb.chunks_exact_mut(3 * width as usize);
    for (target, source) in targets.zip(image.rgb.chunks_exact(3 * image.width as usize)) {
        target[..row].copy_from_slice(&source[..row]);
    }
    Image { width, height, rgb }
}

/// Videos of a window, one after another; what is to be said of them waits for the next frame.
#[derive(Default)]
pub(super) struct WindowVideos {
    recorder: Option<VideoRecorder>,
    finishing: Vec<JoinHandle<()>>,
    outcomes: Arc<Mutex<Vec<Result<FinishedVideo, String>>>>,
    /// A recording has ended, and nobody has been told yet.
    is_ending: bool,
    /// The file that was written last.
    last: Option<PathBuf>,
}

impl WindowVideos {
    /// Begins a video, or ends the one that is being recorded; its last pictures are encoded beside the window.
    pub(super) fn toggle(&mut self, request: VideoRequest, file: &Path, extent: [u32; 2]) {
        if let Some(recorder) = self.recorder.take() {
            self.finish(recorder);
            return;
        }
        match VideoRecorder::begin(request, file, extent) {
            Ok(recorder) => self.recorder = Some(recorder),
            Err(why) => keep(&self.outcomes, Err(why)),
        }
    }

    fn finish(&mut self, recorder: VideoRecorder) {
        self.is_ending = true;
        let outcomes = Arc::clone(&self.outcomes);
        let work = move || keep(&outcomes, recorder.finish());
        // Without a thread the recorder is dropped, which completes its file.
        self.finishing.extend(std::thread::Builder::new().name("video end".to_owned()).spawn(work));
    }

    /// How the present recording does.
    pub(super) fn status(&self) -> Option<VideoStatus> {
        self.recorder.as_ref().map(VideoRecorder::status)
    }

    /// What of this frame belongs into the video; `None` where nothing does.
    pub(super) fn subject_of_next(&self, simulated_s: f64) -> Option<VideoSubject> {
        let recorder = self.recorder.as_ref()?;
        recorder.wants(Instant::now(), simulated_s).then_some(recorder.request.subject)
    }

    /// Size of the pictures of the present recording.
    pub(super) fn extent(&self) -> Option<[u32; 2]> {
        self.recorder.as_ref().map(|recorder| recorder.extent)
    }

    /// When the next frame is due although nothing changes.
    pub(super) fn next_in(&self) -> Option<Duration> {
        self.recorder.as_ref().and_then(VideoRecorder::next_in)
    }

    /// Takes a frame.
    pub(super) fn add(&mut self, image: Image, simulated_s: f64) {
        if let Some(recorder) = &mut self.recorder {
            recorder.add(image, Instant::now(), simulated_s);
        }
    }

    /// What is to be said: a file that is complete, or what went wrong.
    pub(super) fn try_said(&mut self, decimal: DecimalSeparator) -> Option<String> {
        if let Some(recorder) = self.recorder.take_if(|recorder| recorder.has_failed()) {
            self.finish(recorder);
        }
        let outcome = self.outcomes.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let was_ending = std::mem::take(&mut self.is_ending);
        let Some(outcome) = outcome else { return was_ending.then(|| WRITING.to_owned()) };
        Some(outcome.map_or_else(
            |why| why,
            |video| {
                let words = video.words(decimal);
                self.last = Some(video.file);
                words
            },
        ))
    }

    /// The file that was written last.
    pub(super) fn last(&self) -> Option<&Path> {
        self.last.as_deref()
    }

    /// Whether a file is still being completed.
    pub(super) fn is_finishing(&mut self) -> bool {
        self.finishing.retain(|thread| !thread.is_finished());
        !self.finishing.is_empty()
    }
}

fn keep(outcomes: &Mutex<Vec<Result<FinishedVideo, String>>>, outcome: Result<FinishedVideo, String>) {
    outcomes.lock().unwrap_or_else(PoisonError::into_inner).push(outcome);
}

impl Drop for WindowVideos {
    fn drop(&mut self) {
        drop(self.recorder.take());
        for thread in self.finishing.drain(..) {
            if thread.join().is_err() {
                tracing::warn!("a video was not completed");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(grey: u8, [width, height]: [u32; 2]) -> Image {
        Image { width, height, rgb: vec![grey; 3 * width as usize * height as usize] }
    }

    fn window(kind: VideoKind) -> VideoRequest {
        VideoRequest { subject: VideoSubject::Window, kind, lasts_s: None }
    }

    /// The luma of the first pixel of each frame, and the size in the header.
    fn frames(file: &Path) -> (String, Vec<u8>) {
        let bytes = std::fs::read(file).unwrap();
        let end = bytes.iter().position(|byte| *byte == b'\n').unwrap();
        let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let size = |key: char| -> usize {
            header.split(' ').find_map(|word| word.strip_prefix(key)).unwrap().parse().unwrap()
        };
        let frame = b"FRAME\n".len() + size('W') * size('H') * 3 / 2;
        let starts = bytes[end + 1..].chunks(frame).map(|frame| frame[b"FRAME\n".len()]);
        let all = starts.collect();
        (header, all)
    }

    #[test]
    fn each_picture_is_seen_for_as_long_as_the_window_showed_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("seen.y4m");
        let mut recorder = VideoRecorder::begin(window(VideoKind::AsSeen), &file, [33, 20]).unwrap();
        // The first picture comes late, and the video begins with it.
        let begun = Instant::now() + Duration::from_millis(300);
        // At 25 pictures a second: three places, then a pause of seven, then one.
        for (ms, grey) in [(0, 16), (10, 255), (40, 60), (80, 120), (400, 200)] {
            let now = begun + Duration::from_millis(ms);
            let is_wanted = recorder.wants(now, 0.0);
            assert_eq!(is_wanted, ms != 10, "{ms}");
            recorder.add(picture(grey, [33, 20]), now, 0.0);
        }
        assert!((recorder.status().length_s - 11.0 / 25.0).abs() < 1e-9);
        assert!(!file.exists(), "it has its name when it is whole");
        let said = recorder.finish().unwrap().words(DecimalSeparator::Point);
        assert!(said.starts_with("Video of 0.4 s: seen.y4m in /"), "{said}");
        let (header, lumas) = frames(&file);
        assert!(header.contains("W32 H20 F25:1"), "{header}");
        assert_eq!(lumas.len(), 11);
        assert!(lumas[2..10].iter().all(|luma| *luma == lumas[2]) && lumas[10] > lumas[2], "{lumas:?}");
        assert!(lumas[0] < lumas[1] && lumas[1] < lumas[2], "{lumas:?}");
    }

    #[test]
    fn a_time_lapse_has_one_picture_for_each_of_its_simulated_times() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lapse.y4m");
        let kind = VideoKind::TimeLapse { every_s: 2.0 };
        let now = Instant::now();
        let mut recorder = VideoRecorder::begin(window(kind), &file, [8, 8]).unwrap();
        for k in 0..100 {
            let simulated_s = f64::from(k) * 0.1;
            if recorder.wants(now, simulated_s) {
                recorder.add(picture(100, [8, 8]), now, simulated_s);
            }
        }
        assert!(recorder.wants(now, 0.0), "a reset begins anew");
        assert_eq!(recorder.next_in(), None, "it waits for the run");
        assert!((recorder.status().spanned_s - 8.0).abs() < 1e-9);
        let said = recorder.finish().unwrap().words(DecimalSeparator::Point);
        assert!(said.starts_with("Time-lapse of 0.2 s, of 8.0 s of the run: lapse.y4m in /"), "{said}");
        assert_eq!(frames(&file).1.len(), 5);
    }

    #[test]
    fn the_video_keeps_its_size_when_the_window_does_not() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sizes.y4m");
        let begun = Instant::now();
        let mut recorder = VideoRecorder::begin(window(VideoKind::AsSeen), &file, [16, 16]).unwrap();
        for (k, size) in [[16, 16], [40, 6], [6, 40]].into_iter().enumerate() {
            let now = begun + Duration::from_millis(40 * k as u64);
            recorder.add(picture(200, size), now, 0.0);
        }
        recorder.finish().unwrap();
        let (header, lumas) = frames(&file);
        assert!(header.contains("W16 H16"), "{header}");
        assert_eq!(lumas.len(), 3);
    }

    #[test]
    fn where_a_video_cannot_be_begun_it_is_said() {
        let mut videos = WindowVideos::default();
        videos.toggle(window(VideoKind::AsSeen), Path::new("/no/such/folder/video.y4m"), [8, 8]);
        assert_eq!(videos.status(), None);
        let said = videos.try_said(DecimalSeparator::Point).unwrap();
        assert!(said.contains("/no/such/folder/video.y4m"), "{said}");
    }

    #[test]
    fn a_video_that_is_on_when_the_window_closes_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("closed.y4m");
        let mut videos = WindowVideos::default();
        videos.toggle(window(VideoKind::TimeLapse { every_s: 1.0 }), &file, [8, 8]);
        (0..3).for_each(|k| videos.add(picture(50, [8, 8]), f64::from(k)));
        drop(videos);
        assert_eq!(frames(&file).1.len(), 3);
    }
}
