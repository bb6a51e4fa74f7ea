//! ROS messages of compressed images and camera parameters.

use super::message::{MessageReader, header, next_message, write_bytes};
use super::{Header, MessageError, MessageType, RosMessage};
use serde::{Deserialize, Serialize};

/// `sensor_msgs/CompressedImage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Stamp of the exposure, and name of the frame of the camera.
    pub header: Header,
    /// Format, such as `png`.
    pub format: String,
    /// A complete file in that format.
    pub data: Vec<u8>,
}

/// `sensor_msgs/RegionOfInterest`; all zeros mean the whole picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionOfInterest {
    /// Leftmost column, pixels.
    pub x_offset: u32,
    /// Uppermost row, pixels.
    pub y_offset: u32,
    /// Number of rows.
    pub height: u32,
    /// Number of columns.
    pub width: u32,
    /// Whether a rectified region is to be computed from this raw one.
    pub do_rectify: bool,
}

/// `sensor_msgs/CameraInfo`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Stamp of the exposure, and name of the frame of the camera.
    pub header: Header,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Name of the model of lens distortion, such as `plumb_bob`.
    pub distortion_model: String,
    /// Coefficients of that model; zeros mean no distortion.
    #[serde(rename = "D", alias = "d")]
    pub d: Vec<f64>,
    /// Intrinsic matrix of the raw picture, 3 × 3, row by row, pixels.
    #[serde(rename = "K", alias = "k")]
    pub k: [f64; 9],
    /// Rectifying rotation of the camera frame, 3 × 3, row by row.
    #[serde(rename = "R", alias = "r")]
    pub r: [f64; 9],
    /// Projection matrix of the rectified picture, 3 × 4, row by row, pixels.
    #[serde(rename = "P", alias = "p")]
    pub p: [f64; 12],
    /// Columns of the sensor for one pixel; 0 and 1 mean no binning.
    pub binning_x: u32,
    /// Rows of the sensor for one pixel; 0 and 1 mean no binning.
    pub binning_y: u32,
    /// Captured window, in pixels without binning.
    pub roi: RegionOfInterest,
}

impl CameraInfo {
    /// Pinhole camera without distortion.
    pub fn pinhole(header: Header, [width, height]: [u32; 2], [fx, fy, cx, cy]: [f64; 4]) -> Self {
        Self {
            header,
            height,
            width,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.0; 5],
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..Self::default()
        }
    }
}

fn numbers<const N: usize>(from: &mut MessageReader<'_>) -> Result<[f64; N], MessageError> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = from.f64()?;
    }
    Ok(numbers)
}

impl RosMessage for CompressedImage {
    const TYPE: MessageType = MessageType {
        name: "sensor_msgs/CompressedImage",
        md5sum: "8f7a12909da2c9d3332d540a0977563f",
        definition: concat!("Header header\nstring format\nuint8[] data\n", header!()),
    };

    fn write(&self, out: &mut Vec<u8>) {
        self.header.write(out);
        write_bytes(out, self.format.as_bytes());
        write_bytes(out, &self.data);
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        let (header, format) = (Header::read(from)?, from.text()?.to_owned());
        Ok(Self { header, format, data: from.bytes()?.to_vec() })
    }
}

impl RosMessage for CameraInfo {
    const TYPE: MessageType = MessageType {
        name: "sensor_msgs/CameraInfo",
        md5sum: "c9a58c1b0b154e0e6da7578cb991d214",
        definition: concat!(
            "Header header\nuint32 height\nuint32 width\nstring distortion_model\n",
            "float64[] D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P\n",
            "uint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n",
            header!(),
            next_message!("sensor_msgs/RegionOfInterest"),
            "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
        ),
    };

    fn write(&self, out: &mut Vec<u8>) {
        let roi = &self.roi;
        let put = |out: &mut Vec<u8>, words: &[u32]| {
            words.iter().for_each(|word| out.extend(word.to_le_bytes()));
        };
        self.header.write(out);
        put(out, &[self.height, self.width]);
        write_bytes(out, self.distortion_model.as_bytes());
        put(out, &[self.d.len() as u32]);
        let all = self.d.iter().chain(&self.k).chain(&self.r).chain(&self.p);
        all.for_each(|number| out.extend(number.to_le_bytes()));
        put(out, &[self.binning_x, self.binning_y, roi.x_offset, roi.y_offset, roi.height, roi.width]);
        out.push(u8::from(roi.do_rectify));
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        Ok(Self {
            header: Header::read(from)?,
            height: from.u32()?,
            width: from.u32()?,
            distortion_model: from.text()?.to_owned(),
            d: (0..from.u32()?).map(|_| from.f64()).collect::<Result<_, _>>()?,
            k: numbers(from)?,
            r: numbers(from)?,
            p: numbers(from)?,
            binning_x: from.u32()?,
            binning_y: from.u32()?,
            roi: RegionOfInterest {
                x_offset: from.u32()?,
                y_offset: from.u32()?,
                height: from.u32()?,
                width: from.u32()?,
                do_rectify: from.u8()? != 0,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn messages_come_back_as_they_were() {
        let header = Header { seq: 3, frame_id: "car/front".to_owned(), ..Header::default() };
        let image = CompressedImage { header: header.clone(), format: "png".to_owned(), data: vec![1, 2, 3] };
        let info = CameraInfo::pinhole(header, [640, 480], [500.0, 501.0, 319.5, 239.5]);
        let mut bytes = Vec::new();
        image.write(&mut bytes);
        assert_eq!(CompressedImage::decode(&bytes), Ok(image));
        bytes.clear();
        info.write(&mut bytes);
        assert_eq!(CameraInfo::decode(&bytes), Ok(info));
        assert_eq!(CameraInfo::decode(&bytes[..bytes.len() - 1]), Err(MessageError::Torn));
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_strange(bytes in proptest::collection::vec(any::<u8>(), 0..500)) {
            // Any input is decoded or refused, without a panic.
            let _ = CompressedImage::decode(&bytes);
            let _ = CameraInfo::decode(&bytes);
        }
    }
}
