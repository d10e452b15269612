//! The 1 kHz thread: answers each state of the robot.

use std::{sync::Arc, time::Duration};

use catch_body::{JointVector, Robot as Arm};
use catch_driver::{
    clock::Clock,
    control::{Control, Link, Sample},
    enabling_key::EnablingKey,
};
use franka::{FrankaResult, JointPositions, MoveControllerMode, Robot, RobotState, realtime};

use crate::setpoint::{Cycle, Sensed};

/// Silence of the robot after which the link counts as dead.
pub const SILENCE: Duration = Duration::from_millis(20);

/// Begins to hold the arm, and executes plans while `key` is held.
pub fn begin(robot: Arc<Robot>, arm: Arm, key: EnablingKey, clock: Clock) -> Control {
    Control::begin(key, clock, SILENCE, move |link| {
        // Where the priority is not granted `doctor` shows what that costs.
        let _ = realtime::set_current_thread_to_highest_scheduler_priority();
        follow(&robot, arm, link).map_err(|fault| fault.to_string())
    })
}

fn joints(values: [f64; 7]) -> JointVector {
    JointVector::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0))
}

fn sensed(state: &RobotState) -> Sensed {
    Sensed { time_ms: state.time.as_millis(), echo: joints(state.q_d) }
}

/// Answers states until the arm has stopped, or the robot ends the motion.
fn follow(robot: &Robot, arm: Arm, link: &Link) -> FrankaResult<()> {
    let clock = &link.clock;
    let mut control = robot.start_joint_position_control(MoveControllerMode::JointImpedance)?;
    let mut state = control.read_once()?.0;
    let mut cycle = Cycle::new(arm, &sensed(&state), state.time.as_millis());
    let mut last_ms = state.time.as_millis();
    loop {
        let time_ms = state.time.as_millis();
        clock.hear(time_ms);
        let heard_s = clock.now_s();
        link.wait();
        while let Ok(plan) = link.plans.try_recv() {
            cycle.take(&plan);
        }
        if link.has_to_stop() {
            cycle.stop();
        }
        let answer = cycle.answer(&sensed(&state));
        let mut q = JointPositions::new(std::array::from_fn(|i| answer.q[i]));
        q.motion_finished = answer.has_stopped;
        if !answer.has_stopped {
            control.write_once(&q, None)?;
        }
        link.tell(Sample {
            time_s: cycle.time_s(time_ms),
            heard_s,
            q: joints(state.q),
            dq: joints(state.dq),
            echo: joints(state.q_d),
            lost: answer.lost,
            missed: (time_ms - last_ms).saturating_sub(1),
            success_rate: state.control_command_success_rate,
            answer_s: clock.now_s() - heard_s,
            has_stopped: answer.has_stopped,
        });
        if answer.has_stopped {
            return control.write_once(&q, None);
        }
        last_ms = time_ms;
        state = control.read_once()?.0;
    }
}
