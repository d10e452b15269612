//! Poisson's law of restitution with friction.
//!
//! The solver lets contacts end without rebound: that is the compression of an impact, with its friction. The
//! restitution follows here (Anitescu and Potra, 1997). Each point that has begun to push gives e times its
//! impulse of the compression once more. Sweeps then go on over these points until none approaches, and none
//! slides while Coulomb's cone leaves friction to spend (projected Gauss–Seidel). Springs of points that
//! pushed before go on in the next step.
//!
//! Newton's law would ask for a speed at each point instead. With friction that adds energy where a point
//! slides one way before and another way after; and a ball that bounces off one finger onto the other, which
//! it touches already, would make that finger recoil with energy from nowhere.

use super::{
    Impulses,
    colliders::Body,
    contacts::{Contact, Masses, Velocities},
};

/// Most sweeps; a ball between two fingers needs some twenty.
const MOST_SWEEPS: usize = 200;
/// Velocities that differ by less are the same, in m/s.
const SAME_MPS: f64 = 1e-9;

/// Changes the velocities after a step by the rebounds of the points of the object that have begun to push in
/// it. The impulses that this adds are counted.
pub(super) fn let_rebound(
    masses: &Masses,
    contacts: &mut [Contact],
    (friction, restitution): (f64, f64),
    velocities: &mut Velocities,
    impulses: &mut Impulses,
) {
    let rebounds = |it: &&mut Contact| it.touch.pushed == Body::Object && it.is_new();
    let weighted = &mut masses.weighted(velocities);
    for contact in contacts.iter_mut().filter(rebounds) {
        contact.begin_rebound(weighted, restitution * contact.normal.total_ns);
    }
    if contacts.iter().all(|it| it.rebound.is_none()) {
        return;
    }
    for _ in 0..MOST_SWEEPS {
        let sweep = contacts.iter_mut().filter_map(|it| it.rebound_once(weighted, friction));
        if sweep.fold(0.0, f64::max) < SAME_MPS {
            break;
        }
    }
    *velocities = masses.unweighted(weighted);
    for contact in contacts {
        impulses[contact.touch.part as usize] += contact.rebound.map_or(0.0, |it| it.normal_ns);
    }
}
