//! Notes on the margins that decide what a gripper can catch.

use catch_body::{DriveControl, Gripper};
use catch_bot::grasp_selection;

use catch_lab::{
    assets::{Asset, Kind},
    scenario::Scenario,
};

/// The scenario whose margins count: that of real grippers.
const SCENARIO: &str = "honest";

/// Greatest widths and speeds of objects, with the margins of the scenario for real grippers; a line each.
pub(super) fn notes(gripper: &Gripper) -> Vec<String> {
    let margins = Asset::built_in(Kind::Scenario, SCENARIO).and_then(|it| Scenario::of_asset(&it));
    margins.map(|it| notes_of_margins(gripper, &it.brain.grasp_selection)).unwrap_or_default()
}

fn notes_of_margins(gripper: &Gripper, grasping: &grasp_selection::Config) -> Vec<String> {
    let &grasp_selection::Config { finger_margin_m, approach_margin_m, .. } = grasping;
    let widest_mm = |margin_m: f64| (gripper.max_width_m - 2.0 * margin_m) * 1e3;
    let closing = grasping.closing(gripper);
    let two_state = gripper.drive.control == DriveControl::TwoState;
    let travel_m = 2.0 * finger_margin_m;
    let closing_ms = (closing.duration_s(travel_m) + gripper.drive.latency_s) * 1e3;
    // To the palm and back the object is between the fingers for 2·l/v; meanwhile they have to close by what
    // is free beside it.
    let depth_m = gripper.fingertip_y_m() - gripper.palm_y_m();
    let fastest_mps = 2.0 * depth_m * closing.speed_mps / (2.0 * approach_margin_m);
    let mut notes = vec![
        format!(
            "width: brain.grasp_selection.finger_margin_m decides, {:.0} mm on each side in {SCENARIO}: objects up to {:.0} mm; with \
             less free space beside them up to {:.0} mm",
            finger_margin_m * 1e3,
            widest_mm(finger_margin_m),
            widest_mm(approach_margin_m),
        ),
        format!(
            "speed: brain.grasp_selection.approach_margin_m decides, {:.0} mm on each side in {SCENARIO}: the fingers close by that \
             while an object flies {:.0} mm to the palm and back, if it is slower than {fastest_mps:.1} m/s relative to the hand",
            approach_margin_m * 1e3,
            depth_m * 1e3,
        ),
        format!("time: from a command until they have closed by {:.0} mm it takes {closing_ms:.0} ms", travel_m * 1e3),
    ];
    if two_state {
        notes.push("it opens and closes all the way, and waits for every object wide open".to_owned());
    }
    notes
}
