//! A brain of one's own in the arena: `cargo run --release --example 04_own_brain`.
//!
//! This one only holds the arm where it is and closes the gripper when it sees the object within 0.75 m of
//! the arm's base axis. A real cell is brought in the other way round: implement `catch_cell::Cell` for its
//! drivers and give it to `CatchingBot`.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use std::ops::ControlFlow;

use catch_cell::{Brain, CameraModel, Command, GripperMove, Observation, Probe};
use catch_lab::scenario::setup::{Choice, Setup};

struct Watcher {
    cameras: Vec<CameraModel>,
    has_closed: bool,
}

impl Brain for Watcher {
    fn tick(&mut self, observation: &Observation, _: &mut dyn Probe) -> Command {
        let mut nearest_m = f64::INFINITY;
        for frame in &observation.frames {
            let camera = &self.cameras[frame.camera];
            let seen = frame.mask.iter().flatten().enumerate().filter(|(_, is_object)| **is_object);
            for (pixel, _) in seen {
                let p_C = camera.back_project(&frame.window.pixel_centre(pixel), f64::from(frame.depth_m[pixel]));
                let p_W = camera.X_WC * p_C;
                nearest_m = nearest_m.min(libm::hypot(p_W.x, p_W.y));
            }
        }
        let closes = nearest_m < 0.75 && !self.has_closed;
        self.has_closed |= closes;
        let closing = GripperMove { start_s: observation.time_s, width_m: 0.0, speed_mps: 0.4, force_n: 40.0 };
        Command { gripper: closes.then(|| vec![closing]), ..Command::default() }
    }

    fn reset(&mut self) {
        self.has_closed = false;
    }
}

fn main() -> anyhow::Result<()> {
    let setup = Setup::load(&Choice::default())?;
    let mut arena = setup.arena(1, 0);
    let mut brain = Watcher { cameras: setup.cameras.clone(), has_closed: false };
    let Ok(()) = catch_cell::run(&mut arena, &mut brain, |arena, _, _, _| {
        if arena.time_s() < 1.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    let last = arena.truth().samples.last().copied();
    let Some(sample) = last else { return Ok(()) };
    println!("after {:.2} s the object is at {:.3?} m", sample.time_s, sample.X_WO.translation.vector.as_slice());
    println!("the gripper is {:.0} mm open", sample.width_m * 1e3);
    Ok(())
}
