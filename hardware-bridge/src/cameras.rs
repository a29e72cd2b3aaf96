//! The tactile cameras: behind the camera board, as UVC devices, or behind the robot's own driver.

use hand_model::robot::TactileFrame;

use crate::clock::Clock;
use crate::config::BridgeConfig;
use crate::delivered_images::DeliveredImages;
use crate::tactile_link::TactileLink;
use crate::tactile_link::counters::CameraCounters;
use crate::tactile_link::link::TactileLinkError;

/// Error of opening the cameras.
#[derive(Debug, thiserror::Error)]
pub enum CamerasError {
    #[error(transparent)]
    Board(#[from] TactileLinkError),
    /// The UVC devices show another number of cameras than the hand has.
    #[error("uvc: found {found} cameras, expected {expected}")]
    Number { found: usize, expected: usize },
    /// Error of a UVC device.
    #[cfg(feature = "uvc")]
    #[error(transparent)]
    Uvc(#[from] crate::uvc::device::UvcError),
    /// The program was built without UVC support.
    #[error("uvc: found {0} devices, expected none: this program was built without the feature `uvc`")]
    NoUvc(usize),
}

/// Open cameras.
pub enum Cameras {
    /// Behind the camera board.
    Board(TactileLink),
    /// UVC devices.
    #[cfg(feature = "uvc")]
    Uvc(crate::uvc::UvcCameras),
    /// Behind the robot's own driver.
    Delivered(DeliveredImages),
}

impl Cameras {
    /// Opens the configured cameras of a hand with `cameras` cameras; `None` if none are configured.
    ///
    /// # Errors
    /// [`CamerasError`].
    pub fn open(config: &BridgeConfig, cameras: usize, clock: &Clock) -> Result<Option<Self>, CamerasError> {
        if let Some(board) = &config.cameras {
            return Ok(Some(Self::Board(TactileLink::open(&board.port, cameras, clock.clone())?)));
        }
        if config.uvc.is_empty() {
            return Ok(None);
        }
        // The configuration lists every camera once.
        let found: usize = config.uvc.iter().map(|device| device.squares.len()).sum();
        if found != cameras {
            return Err(CamerasError::Number { found, expected: cameras });
        }
        #[cfg(feature = "uvc")]
        return Ok(Some(Self::Uvc(crate::uvc::UvcCameras::open(&config.uvc, cameras, clock)?)));
        #[cfg(not(feature = "uvc"))]
        Err(CamerasError::NoUvc(config.uvc.len()))
    }

    /// Returns the link to the camera board, if that is the connection.
    pub fn board(&self) -> Option<&TactileLink> {
        match self {
            Self::Board(link) => Some(link),
            #[cfg(feature = "uvc")]
            Self::Uvc(_) => None,
            Self::Delivered(_) => None,
        }
    }

    /// Requests one image of every camera.
    ///
    /// # Errors
    /// Error of the board's port.
    pub fn request_capture(&self) -> Result<(), TactileLinkError> {
        match self {
            Self::Board(link) => link.request_capture(),
            #[cfg(feature = "uvc")]
            Self::Uvc(cameras) => {
                cameras.request_capture();
                Ok(())
            }
            Self::Delivered(images) => {
                images.request();
                Ok(())
            }
        }
    }

    /// Returns the images finished since the last call.
    pub fn take_images(&self) -> Vec<TactileFrame> {
        match self {
            Self::Board(link) => link.take_images(),
            #[cfg(feature = "uvc")]
            Self::Uvc(cameras) => cameras.take_images(),
            Self::Delivered(images) => images.take(),
        }
    }

    /// Returns the counters of every camera; a robot's own driver has none.
    pub fn camera_counters(&self) -> Vec<CameraCounters> {
        match self {
            Self::Board(link) => link.camera_counters(),
            #[cfg(feature = "uvc")]
            Self::Uvc(cameras) => cameras.camera_counters(),
            Self::Delivered(_) => Vec::new(),
        }
    }

    /// Returns the reason why the cameras stopped working, if they did.
    pub fn failure(&self) -> Option<String> {
        match self {
            Self::Board(link) => link.port_error(),
            #[cfg(feature = "uvc")]
            Self::Uvc(cameras) => cameras.failure(),
            Self::Delivered(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::tests::GOOD;

    #[test]
    fn webcams_that_show_another_hands_cameras_are_refused() {
        let webcam = "[[uvc]]\ndevice = \"X\"\nsize = [480, 240]\nformat = \"mjpeg\"\n\
                      squares = [{ camera = 0, x = 0, y = 0 }, { camera = 1, x = 240, y = 0 }]\n";
        let config = BridgeConfig::parse(&format!("{GOOD}\n{webcam}"), Path::new("bridge.toml")).expect("good");
        let error = Cameras::open(&config, 18, &Clock::wall()).err().expect("another hand's").to_string();
        assert_eq!(error, "uvc: found 2 cameras, expected 18");
    }
}
