//! The sockets on which another terminal can stop a robot.

use std::path::Path;
use std::sync::Arc;

use crate::clock::Clock;
use crate::remote::endpoint::{RemoteEndpoint, RequestHandler};
use crate::remote::{RemoteError, socket_paths};
use crate::requests;
use crate::servo_cycle::CycleShared;

/// Sockets on which a robot can be stopped.
pub(crate) struct StopSockets<'a> {
    /// File after which the default socket is named, which any terminal finds.
    pub file: &'a Path,
    /// Additional socket.
    pub additional: Option<&'a Path>,
}

impl StopSockets<'_> {
    /// Opens the sockets.
    pub fn open(
        &self,
        shared: &Arc<CycleShared>,
        clock: &Clock,
        release_time: f64,
    ) -> Result<Vec<RemoteEndpoint>, RemoteError> {
        let failed = |source| RemoteError::Socket { path: socket_paths::OPERATORS_FOLDER.into(), source };
        let folder = socket_paths::folder().map_err(failed)?;
        socket_paths::remove_stale_sockets(&folder.path);
        let of = format!("{}, process {}", self.file.display(), std::process::id());
        let (shared, clock) = (shared.clone(), clock.clone());
        let fulfil: Arc<RequestHandler> =
            Arc::new(move |request| requests::execute_request(&shared, &clock, request, release_time));
        let path = socket_paths::socket_path(&folder.path, self.file);
        let mut endpoints = vec![RemoteEndpoint::open(&path, folder.group, &of, fulfil.clone())?];
        if let Some(own) = self.additional {
            endpoints.push(RemoteEndpoint::open(own, None, &of, fulfil)?);
        }
        Ok(endpoints)
    }
}
