//! The referee's rule for any cell whose truth is known: another simulator, or a real cell that is measured.

use catch_sim::Truth;
pub use catch_sim::{TruthSample, truth::Contact};

use super::{
    Evidence, first_contact_s,
    reason::{self, Reason},
};

/// Returns the reason why an object was not caught and held, by the rule for the arena's throws; `None` if it
/// was. Of the samples it needs the times, the poses of gripper and object, the widths, the joint velocities
/// and the parts that touch. The disturbance test begins at `disturbed_since_s`. Broken limits of the arm are
/// left out.
pub fn why_not_held(samples: Vec<TruthSample>, disturbed_since_s: Option<f64>) -> Option<Reason> {
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
