//! Newton's law of restitution.
//!
//! The solver lets contacts end without rebound. Here impulses are added after a step, at all points at once,
//! by sweeps that go on until all agree (Gauss–Seidel on the normal velocities, impulses that only push): by
//! one sweep, of two points that meet in the same step, the second would undo part of what the first was
//! given, or add to it.
//!
//! Only points that begin to push in the same step count. With one restitution for all of them no energy is
//! gained; to ask a ball that bounces off one finger to stay at the other, which it touches already, would
//! make that finger recoil with energy from nowhere.

use super::{
    Impulses,
    colliders::Body,
    contacts::{Contact, Masses, Rebound, Velocities},
};

/// Most sweeps; a ball between two fingers needs some twenty.
const MOST_SWEEPS: usize = 200;
/// Velocities that differ by less are the same, in m/s.
const SAME_MPS: f64 = 1e-9;

/// Makes the velocities after a step those of Newton's law at all points of the object that have begun to
/// push in it. The impulses that this adds are counted.
pub(super) fn let_rebound(
    masses: &Masses,
    contacts: &mut [Contact],
    restitution: f64,
    (before, velocities): (&Velocities, &mut Velocities),
    impulses: &mut Impulses,
) {
    let before = masses.weighted(before);
    for contact in &mut *contacts {
        let wanted_mps = -restitution * contact.normal.row.velocity(&before);
        let rebounds = contact.is_new() && contact.touch.pushed == Body::Object && wanted_mps > 0.0;
        contact.rebound = rebounds.then_some(Rebound { wanted_mps, impulse_ns: contact.normal.total_ns });
    }
    if contacts.iter().all(|contact| contact.rebound.is_none()) {
        return;
    }
    let mut weighted = masses.weighted(velocities);
    for _ in 0..MOST_SWEEPS {
        let mut largest_mps = 0.0f64;
        for contact in &mut *contacts {
            let Some(Rebound { wanted_mps, impulse_ns }) = contact.rebound else { continue };
            let row = &contact.normal.row;
            let missing_ns = (wanted_mps - row.velocity(&weighted)) / row.mobility_per_kg;
            let change_ns = (impulse_ns + missing_ns).max(0.0) - impulse_ns;
            row.push(&mut weighted, change_ns);
            largest_mps = largest_mps.max((change_ns * row.mobility_per_kg).abs());
            contact.rebound = Some(Rebound { wanted_mps, impulse_ns: impulse_ns + change_ns });
        }
        if largest_mps < SAME_MPS {
            break;
        }
    }
    *velocities = masses.unweighted(&weighted);
    for contact in contacts {
        if let Some(Rebound { impulse_ns, .. }) = contact.rebound {
            impulses[contact.touch.part as usize] += impulse_ns - contact.normal.total_ns;
        }
    }
}
