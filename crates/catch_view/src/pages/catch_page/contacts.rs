//! Contacts of the object with the hand as pages carry them.

use catch_sim::{Contact, TruthSample};
use nalgebra::Point3;
use serde_json::{Value, json};

use crate::playback::Playback;

/// Contacts that a page carries at most.
const MOST_CONTACTS: usize = 60;
/// A part is touched anew after it was free for so long, in seconds.
const FREE_S: f64 = 0.01;

/// Names of the parts of the hand.
const PARTS: [&str; 3] = ["left finger", "right finger", "palm"];

/// Contacts with parts of the hand, from their beginnings, in the order of time.
pub fn contacts(playback: &Playback) -> Vec<Value> {
    let Some(samples) = playback.ground_truth().map(|it| &it.truth.samples) else { return Vec::new() };
    let mut contacts = Vec::new();
    for (part, name) in PARTS.into_iter().enumerate() {
        let mut last_s = f64::NEG_INFINITY;
        let touches =
            |Contact { left_finger, right_finger, palm, .. }: Contact| [left_finger, right_finger, palm][part];
        for (i, sample) in samples.iter().enumerate().filter(|(_, it)| touches(it.contact)) {
            if sample.time_s > last_s + FREE_S {
                let first = samples[i..].iter().take_while(|it| it.time_s <= sample.time_s + FREE_S);
                let contact = json!({
                    "time_s": sample.time_s - playback.start_s(),
                    "part": name,
                    // Point of the part that is nearest to the object's centre of mass, in G.
                    "p_G": <[f64; 3]>::from(nearest_point(playback, sample, part)),
                    // Largest normal impulse of a step within the first 10 ms, in N·s.
                    "impulse_ns": first.map(|it| it.contact.peak_impulse_ns).fold(0.0, f64::max),
                });
                contacts.push((sample.time_s, contact));
            }
            last_s = sample.time_s;
        }
    }
    contacts.sort_by(|a, b| a.0.total_cmp(&b.0));
    contacts.into_iter().take(MOST_CONTACTS).map(|(_, contact)| contact).collect()
}

/// Point of a finger (0 or 1) or of the housing (2) that is nearest to the object's centre of mass, in G.
fn nearest_point(playback: &Playback, sample: &TruthSample, part: usize) -> Point3<f64> {
    let gripper = &playback.gripper;
    let cuboid = gripper.fingers(sample.width_m).get(part).copied().unwrap_or_else(|| gripper.body());
    let object_G = sample.X_WG.inverse_transform_point(&Point3::from(sample.X_WO.translation.vector));
    let half = cuboid.size / 2.0;
    let offset = object_G - cuboid.centre;
    cuboid.centre + offset.zip_map(&half, |value, most| value.clamp(-most, most))
}
