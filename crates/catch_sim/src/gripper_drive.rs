//! The gripper's drive: moves the fingers and squeezes. It knows its own fingers and nothing of the object.

mod grasp_watch;
mod interface;

use catch_body::{DriveControl, Gripper};
use catch_cell::{GripperMove, GripperQueue, GripperState};

use crate::{config::GripperDriveKind, random_streams::Draws};
use grasp_watch::GraspWatch;
use interface::{Interface, Ramp};

/// Inertia of motor and gear of a real drive, reflected to each finger, in kg. Chosen, as no figure is
/// published: it lets the fingers keep to their speed when something slips out from between them.
pub const DRIVE_MASS_KG: f64 = 0.5;
/// The most that a finger presses with in the authors' code, in N: half of what its controller gives both.
const PUBLISHED_FORCE_N: f64 = 500.0;
/// The width that open fingers are commanded there, in metres: beyond their stops.
const PUBLISHED_OPEN_WIDTH_M: f64 = 1.0;
/// The controller's cycle there, in seconds, by which it takes the rate of the commanded width: a jump is
/// pushed after with all the force there is, one cycle later.
const PUBLISHED_CYCLE_S: f64 = 1e-3;

/// Position controller of each finger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Force per metre, in N/m.
    pub stiffness_npm: f64,
    /// Force per speed, in N·s/m.
    pub damping_nspm: f64,
}

impl Gains {
    /// Gains of the authors' code.
    pub const PUBLISHED: Self = Self { stiffness_npm: 2500.0, damping_nspm: 20.0 };

    /// Gains as stiff as a controller at 1 kHz may have with fingers of 50 g: it follows within a
    /// millisecond, and a finger that is stopped by an object presses with all its force 2 ms later. Lighter
    /// fingers have less: with the same gains they would be unstable.
    fn ideal(finger_mass_kg: f64) -> Self {
        let lighter = (finger_mass_kg / 0.05).min(1.0);
        Self { stiffness_npm: 10_000.0 * lighter, damping_nspm: 40.0 * lighter }
    }

    /// Critically damped, at the natural frequency ω in rad/s, for a finger with its fraction of the drive: k
    /// = m·ω², d = 2·m·ω.
    fn critical(mass_kg: f64, bandwidth_radps: f64) -> Self {
        Self { stiffness_npm: mass_kg * bandwidth_radps.powi(2), damping_nspm: 2.0 * mass_kg * bandwidth_radps }
    }
}

/// Executes gripper moves.
#[derive(Debug, Clone)]
pub struct GripperDrive {
    /// Gains of its controllers.
    pub gains: Gains,
    gripper: Gripper,
    max_force_n: f64,
    active: ActiveMove,
    queue: GripperQueue,
    squeeze_n: f64,
    watch: GraspWatch,
    law: Law,
}

/// A move and where it started from.
#[derive(Debug, Clone, Copy)]
struct ActiveMove {
    order: GripperMove,
    from_m: f64,
    since_s: f64,
}

/// Control law that turns a move into a motion.
#[derive(Debug, Clone)]
enum Law {
    /// Ideal law: at once, at any speed.
    Ideal,
    /// Position law: at once, with all the force there is; beyond the stops when open.
    Position,
    /// Law of a real gripper: through an interface, within the limits of the fingers.
    Real(Interface, Ramp),
}

impl GripperDrive {
    /// The drive that a scenario names; it holds the fingers `width_m` apart. `draws` decide where in its
    /// cycle a real one stands at t = 0.
    pub fn new(kind: GripperDriveKind, gripper: &Gripper, width_m: f64, draws: &mut Draws) -> Self {
        let Gripper { max_speed_mps, max_force_n, finger_mass_kg, .. } = *gripper;
        let (gains, max_force_n, law) = match kind {
            GripperDriveKind::Ideal => (Gains::ideal(finger_mass_kg), max_force_n, Law::Ideal),
            GripperDriveKind::Real => {
                let mass_kg = finger_mass_kg + DRIVE_MASS_KG;
                let interface = Interface::new(gripper, width_m, draws.unit());
                let law = Law::Real(interface, Ramp::new(gripper, width_m, mass_kg));
                (Gains::critical(mass_kg, interface::BANDWIDTH_RADPS), max_force_n, law)
            }
            GripperDriveKind::Position => (Gains::PUBLISHED, PUBLISHED_FORCE_N, Law::Position),
        };
        let order = GripperMove { start_s: 0.0, width_m, speed_mps: max_speed_mps, force_n: max_force_n };
        let mut drive = Self {
            gains,
            gripper: gripper.clone(),
            max_force_n,
            active: ActiveMove { order, from_m: width_m, since_s: 0.0 },
            queue: GripperQueue::default(),
            squeeze_n: 0.0,
            watch: GraspWatch::default(),
            law,
        };
        drive.active.order = drive.as_driven(order);
        drive
    }

    /// Moves that were rejected because a number was not finite, or speed or force not above zero.
    pub fn refused_moves(&self) -> u32 {
        self.queue.rejected()
    }

    /// The width of the move that is being carried out.
    pub fn commanded_width_m(&self) -> f64 {
        self.active.order.width_m
    }

    /// Time of the first cycle of the drive's connection, in seconds on the cell's clock; `None` for a drive
    /// without one.
    pub fn phase_s(&self) -> Option<f64> {
        if let Law::Real(interface, _) = &self.law { Some(interface.phase_s) } else { None }
    }

    /// Replaces all moves that have not started at `now_s`. One that should have started begins at once.
    pub fn receive(&mut self, moves: &[GripperMove], now_s: f64) {
        self.queue.receive(moves, now_s);
    }

    /// Forces that open the left and the right finger during the step that begins at `time_s`, from their
    /// distances to the middle and their speeds.
    ///
    /// The fingers are geared to each other: one controller acts on their mean, with a force up to that of
    /// the move, and another stands for the gear that keeps them symmetrical; it must also work while the
    /// first is at its limit.
    pub fn forces(&mut self, time_s: f64, finger_m: [f64; 2], finger_mps: [f64; 2]) -> [f64; 2] {
        let (width_m, rate_mps) = (finger_m[0] + finger_m[1], finger_mps[0] + finger_mps[1]);
        self.begin_due_moves(time_s, width_m);
        let Gains { stiffness_npm, damping_nspm } = self.gains;
        let ActiveMove { order, .. } = self.active;
        let limit = order.force_n.min(self.max_force_n);
        let setpoint = match &mut self.law {
            Law::Ideal => self.active.jump(time_s),
            Law::Position => self.active.jump_by_cycle(time_s, PUBLISHED_CYCLE_S),
            // The controller's output is at its limit where the setpoint is this far ahead; it need not go
            // further.
            Law::Real(_, ramp) => ramp.advance(time_s, &order, width_m, 2.0 * limit / stiffness_npm),
        };
        let [wanted_m, wanted_mps] = setpoint.map(|of_width| of_width / 2.0);
        let skew = [(finger_m[0] - finger_m[1]) / 2.0, (finger_mps[0] - finger_mps[1]) / 2.0];
        let ahead_n = if let Law::Real(_, ramp) = &self.law { ramp.force_n() } else { 0.0 };
        let opening = stiffness_npm * (wanted_m - width_m / 2.0) + damping_nspm * (wanted_mps - rate_mps / 2.0);
        let opening = (opening + ahead_n).clamp(-limit, limit);
        let levelling = (stiffness_npm * skew[0] + damping_nspm * skew[1]).clamp(-self.max_force_n, self.max_force_n);
        self.squeeze_n = -opening;
        self.watch.update(width_m, rate_mps, order.width_m, self.squeeze_n / limit);
        let state = self.live_state(width_m, rate_mps);
        if let Law::Real(interface, _) = &mut self.law {
            interface.refresh(time_s, state);
        }
        [opening - levelling, opening + levelling]
    }

    fn begin_due_moves(&mut self, time_s: f64, width_m: f64) {
        let begins_s = |sent_s: f64| match &self.law {
            Law::Ideal | Law::Position => sent_s,
            Law::Real(interface, _) => interface.takes_effect_s(sent_s),
        };
        while let Some(order) = self.queue.take_due(time_s, begins_s) {
            let order = self.as_driven(order);
            self.active = ActiveMove { order, from_m: width_m, since_s: time_s };
            self.watch.begin(width_m, order.width_m);
        }
    }

    /// A move as this drive makes it.
    fn as_driven(&self, order: GripperMove) -> GripperMove {
        let width_m = self.gripper.driven_width_m(order.width_m);
        let width_m = match self.law {
            Law::Position if width_m >= self.gripper.max_width_m => PUBLISHED_OPEN_WIDTH_M,
            Law::Position => width_m,
            _ if self.gripper.drive.control == DriveControl::SpeedAndForce => return GripperMove { width_m, ..order },
            _ => width_m,
        };
        GripperMove { width_m, speed_mps: f64::INFINITY, force_n: self.max_force_n, ..order }
    }

    /// Squeezes from now on, with all the force there is.
    pub fn squeeze(&mut self, now_s: f64) {
        let force_n = self.max_force_n;
        self.receive(&[GripperMove { start_s: now_s, width_m: 0.0, speed_mps: f64::INFINITY, force_n }], now_s);
    }

    fn live_state(&self, width_m: f64, speed_mps: f64) -> GripperState {
        GripperState { width_m, speed_mps, force_n: self.squeeze_n, grasp: self.watch.state }
    }

    /// State that the gripper reports.
    pub fn state(&self, finger_m: [f64; 2], finger_mps: [f64; 2]) -> GripperState {
        match &self.law {
            Law::Ideal | Law::Position => self.live_state(finger_m[0] + finger_m[1], finger_mps[0] + finger_mps[1]),
            Law::Real(interface, _) => interface.reported,
        }
    }
}

impl ActiveMove {
    /// The width that a position drive wants at `time_s`, and its rate: the jump's difference quotient, one
    /// cycle after it.
    fn jump_by_cycle(&self, time_s: f64, cycle_s: f64) -> [f64; 2] {
        let cycles = (time_s - self.since_s) / cycle_s;
        let rate_mps = if (cycles - 1.0).abs() < 0.5 { (self.order.width_m - self.from_m) / cycle_s } else { 0.0 };
        [self.order.width_m, rate_mps]
    }

    /// The width that an ideal drive wants at `time_s`, and its rate: at the speed of the move from its first
    /// instant on.
    fn jump(&self, time_s: f64) -> [f64; 2] {
        let Self { order, from_m, since_s } = *self;
        let way = order.width_m - from_m;
        let travelled = order.speed_mps * (time_s - since_s).max(0.0);
        if order.speed_mps.is_finite() && travelled < way.abs() {
            [from_m + way.signum() * travelled, way.signum() * order.speed_mps]
        } else {
            [order.width_m, 0.0]
        }
    }
}
