//! What a page may send: JSON objects, one a message.

use city3d_protocol::snapshot::{Indicator, Pedals};
use serde::Deserialize;

/// Longest message of a page, bytes.
pub(crate) const MAX_MESSAGE_BYTES: usize = 4096;
/// Pictures of a page at once: the large one and the preview.
pub(crate) const SLOTS: usize = 2;

/// A message of a page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "t", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum PageMessage {
    /// The first one: with the token, or without to watch.
    Hello {
        token: Option<String>,
    },
    Start,
    Pause,
    Reset,
    Step,
    /// Multiple of real time.
    Speed {
        factor: f64,
    },
    /// Shows a log at another time.
    Seek {
        time_s: f64,
    },
    /// Pedals of a person; without new ones for a while the vehicle is handed back.
    Drive {
        vehicle: u32,
        pedals: PagePedals,
    },
    Release,
    /// Comes as a guest, with a car of its own.
    Join,
    /// Goes as a guest, and takes its car along.
    Leave,
    /// What to draw in one of the page's pictures.
    Look {
        slot: usize,
        view: Option<PageView>,
        width: u32,
        height: u32,
        /// Pictures as H.264, where the server makes it.
        #[serde(default)]
        h264: bool,
    },
    /// The page has shown the last picture, and wants another one.
    Seen {
        slot: usize,
    },
    /// Is answered with the same number, and shows that the page is there.
    Ping {
        sent_ms: f64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PagePedals {
    gas: f64,
    brake: f64,
    handbrake: f64,
    steering_rad: f64,
    #[serde(default)]
    reverse: bool,
}

impl PagePedals {
    pub(crate) fn pedals(self) -> Pedals {
        let Self { gas, brake, handbrake, steering_rad, reverse } = self;
        Pedals { gas, brake, handbrake, steering_rad, reverse, indicator: Indicator::Off }.clamped()
    }
}

/// A camera that a page asks for. The numbers are whole, so that pages which look alike share a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(tag = "mode", rename_all = "snake_case", deny_unknown_fields)]
#[cfg_attr(not(feature = "render"), allow(dead_code, reason = "nothing is drawn"))]
pub(crate) enum PageView {
    Onboard { vehicle: u32 },
    Chase { vehicle: u32 },
    Orbit { x_m: i32, y_m: i32, distance_m: i32, azimuth_deg: i32, elevation_deg: i32 },
    Overhead { x_m: i32, y_m: i32, height_m: i32 },
}
