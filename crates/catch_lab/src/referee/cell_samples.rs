//! The referee's rule for any cell whose truth is known: another simulator, or a real cell that is measured.

use catch_body::{JointVector, Pose, Twist};
use catch_sim::{Truth, TruthSample, truth::Contact};

use super::{
    Evidence, first_contact_s,
    reason::{self, Reason},
};

/// The state of a cell at one instant, as far as the rule needs it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellSample {
    /// Time in seconds on the cell's clock.
    pub time_s: f64,
    /// Pose of the gripper.
    pub X_WG: Pose,
    /// Pose of the object.
    pub X_WO: Pose,
    /// Distance between the fingers' inner faces in metres.
    pub width_m: f64,
    /// The width that the gripper is commanded to have.
    pub commanded_width_m: f64,
    /// Joint velocities in rad/s.
    pub dq: JointVector,
    /// Contacts of the object with left finger, right finger, palm, arm, floor, an obstacle.
    pub touches: [bool; 6],
}

/// Returns the reason why an object was not caught and held, by the rule for the arena's throws; `None` if it
/// was. The disturbance test begins at `disturbed_since_s`. Broken limits of the arm are left out.
pub fn why_not_held(samples: &[CellSample], disturbed_since_s: Option<f64>) -> Option<Reason> {
    let samples = samples.iter().map(TruthSample::from).collect();
    let truth = Truth { samples, disturbed_since_s, ..Truth::default() };
    let evidence = Evidence {
        truth: &truth,
        snapshots: &[],
        contact_s: first_contact_s(&truth),
        last: None,
        catch_s: None,
        at_catch: None,
        undisturbed_O: None,
        known: None,
    };
    reason::why_not_held(&evidence)
}

impl From<&CellSample> for TruthSample {
    /// Converts a sample, with zeros for the fields that the rule does not need.
    fn from(sample: &CellSample) -> Self {
        let CellSample { time_s, X_WG, X_WO, width_m, commanded_width_m, dq, touches } = *sample;
        let [left_finger, right_finger, palm, arm, floor, obstacle] = touches;
        Self {
            time_s,
            q: JointVector::zeros(),
            dq,
            torque: JointVector::zeros(),
            X_WG,
            V_WG: Twist::default(),
            width_m,
            commanded_width_m,
            finger_force_n: [0.0; 2],
            X_WO,
            V_WO: Twist::default(),
            contact: Contact { left_finger, right_finger, palm, arm, floor, obstacle, peak_impulse_ns: 0.0 },
        }
    }
}
