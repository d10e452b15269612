//! Failures that a real cell can report instead of an observation.

use thiserror::Error;

/// A failure of a real cell, for the drivers of arms, grippers and cameras to return.
///
/// The arm is safe whenever one is returned: every trajectory ends at rest.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CellFault {
    /// A device does not answer any more.
    #[error("lost connection to {device}: {cause}")]
    LostConnection {
        /// Name of the device, such as "arm", or its address.
        device: String,
        /// Cause that the connection reported.
        cause: String,
    },
    /// The arm has stopped by itself, and waits for somebody to release it.
    #[error("protective stop of the arm: {cause}")]
    ProtectiveStop {
        /// Cause that the arm's controller reported.
        cause: String,
    },
    /// The gripper has switched itself off, or does not do what it is asked to.
    #[error("fault of the gripper: {cause}")]
    GripperFault {
        /// Cause that the gripper reported.
        cause: String,
    },
}
