//! Recorded throws through the maker's protocol: `franka-sim` in lock-step, its motion limits and
//! communication constraints enforced.

use std::{
    env,
    path::{Path, PathBuf},
    time::Instant,
};

use catch_body::{JointVector, Robot as Arm, robot::LimitScale};
use catch_cell::{ArmTrajectory, Executor, ExecutorConfig};
use catch_driver::{braking::CYCLE_S, motion};
use catch_franka::{
    margin,
    setpoint::{Cycle, Sensed},
};
use catch_recording::{Part, RecordingReader, replay::RECORDED, sources::Sources};
use franka::{FrankaError, JointPositions, MoveControllerMode, Robot};
use serde::de::IgnoredAny;

use crate::server::{Server, root};

/// Time from a tick until its command arrives.
const LATENCY_S: f64 = 0.004;

struct Throw {
    sources: Sources,
    ready_q: JointVector,
    /// Trajectories with their times of arrival.
    plans: Vec<(f64, ArmTrajectory)>,
}

impl Throw {
    fn read(file: &Path) -> Self {
        let mut reader = RecordingReader::<IgnoredAny, IgnoredAny>::open(file).unwrap();
        let cell = reader.header.cell.clone();
        let (arm, _) = cell.sources.parse(&RECORDED).unwrap();
        let ready_q = arm.checked_pose("recording", "ready_rad", &cell.ready_rad).unwrap();
        let mut plans = Vec::new();
        while let Part::Tick(tick) = reader.next_part().unwrap() {
            if let Some(plan) = tick.command.arm {
                plans.push((tick.observation.time_s + LATENCY_S, plan));
            }
        }
        Self { sources: cell.sources, ready_q, plans }
    }

    /// The throws of `target/franka/aSCALE`, which were planned with that fraction of the acceleration limit.
    fn all(scale: &str) -> Vec<Self> {
        let most = env::var("THROWS").ok().and_then(|it| it.parse().ok()).unwrap_or(usize::MAX);
        let folder = root().join("target/franka").join(format!("a{scale}"));
        let mut files: Vec<PathBuf> = folder.read_dir().unwrap().map(|it| it.unwrap().path()).collect();
        files.retain(|it| it.extension().is_some_and(|it| it == "catch"));
        files.sort();
        files.iter().take(most).map(|it| Self::read(it)).collect()
    }

    /// The way from `from` to the waiting pose, and the plans of the throw once it is reached.
    fn from(&self, from: JointVector, arm: &Arm) -> Vec<(f64, ArmTrajectory)> {
        let way = motion::straight(0, 0.01, [from, self.ready_q], arm, 0.3);
        let lead_s = way.end_s() + 0.05;
        let mut plans = vec![(0.005, way)];
        for (arrival_s, plan) in &self.plans {
            let mut plan = plan.clone();
            plan.spline.knots_s.iter_mut().for_each(|it| *it += lead_s);
            plans.push((arrival_s + lead_s, plan));
        }
        plans
    }

    /// The arm with its maker's limits, and with those of the plans.
    fn arms(&self) -> [Arm; 2] {
        let unscaled = Sources { limit_scale: LimitScale::default(), ..self.sources.clone() };
        [&unscaled, &self.sources].map(|it| {
            let (arm, gripper) = it.parse(&RECORDED).unwrap();
            arm.carrying(&gripper)
        })
    }
}

#[derive(Debug, Default)]
struct Figures {
    throws: usize,
    plans: usize,
    rejected: usize,
    cycles: usize,
    lost: u64,
    reflexes: usize,
    rejoin_cycles: usize,
    setpoint_error_rad: f64,
    q_error_rad: f64,
    q_error_squared: f64,
    acceleration_radps2: f64,
    jerk_radps3: f64,
    slowest_cycle_us: f64,
}

impl Figures {
    fn told(&self, what: &str) {
        println!(
            "{what}: {} throws, {} plans ({} rejected), {} cycles, {} lost, {} reflexes; set-point error {:.1e} rad, arm {:.2} mrad \
             ({:.2} rms), acceleration {:.2} rad/s², jerk {:.0} rad/s³, way back {} cycles, answer {:.0} µs at most",
            self.throws,
            self.plans,
            self.rejected,
            self.cycles,
            self.lost,
            self.reflexes,
            self.setpoint_error_rad,
            1e3 * self.q_error_rad,
            1e3 * self.q_rms_rad(),
            self.acceleration_radps2,
            self.jerk_radps3,
            self.rejoin_cycles,
            self.slowest_cycle_us,
        );
    }

    fn q_rms_rad(&self) -> f64 {
        (self.q_error_squared / (7 * self.cycles) as f64).sqrt()
    }

    /// One motion: the plans as they arrive, until the last has ended.
    fn moves(
        &mut self,
        robot: &Robot,
        [arm, planned]: &[Arm; 2],
        plans: impl Fn(JointVector) -> Vec<(f64, ArmTrajectory)>,
    ) -> Result<(), FrankaError> {
        let joints = |values: [f64; 7]| JointVector::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0));
        let mut control = robot.start_joint_position_control(MoveControllerMode::JointImpedance)?;
        let (state, _) = control.read_once()?;
        let origin_ms = state.time.as_millis();
        let first = Sensed { time_ms: origin_ms, echo: joints(state.q_d) };
        let mut cycle = Cycle::new(arm.clone(), &first, origin_ms);
        let mut checker = Executor::new(planned.clone(), first.echo, ExecutorConfig::default());
        let plans = plans(first.echo);
        let (mut ahead, mut end_s, mut state) = (plans.iter().peekable(), 0.0_f64, state);
        loop {
            let sensed = Sensed { time_ms: state.time.as_millis(), echo: joints(state.q_d) };
            let time_s = cycle.time_s(sensed.time_ms);
            while let Some((arrival_s, plan)) = ahead.next_if(|it| it.0 <= time_s) {
                self.plans += 1;
                if let Err(why) = checker.receive(plan, *arrival_s) {
                    println!("  plan {}: {why}", plan.id);
                    self.rejected += 1;
                    continue;
                }
                cycle.take(plan);
                end_s = end_s.max(plan.end_s());
            }
            let began = Instant::now();
            let answer = cycle.answer(&sensed);
            self.slowest_cycle_us = self.slowest_cycle_us.max(began.elapsed().as_secs_f64() * 1e6);
            let on_plan = checker.setpoint(time_s).q;
            let off = (joints(state.q) - on_plan).amax();
            self.q_error_rad = self.q_error_rad.max(off);
            self.q_error_squared += (joints(state.q) - on_plan).norm_squared();
            if answer.lost == 0 && answer.rejoin_cycles == 0 {
                self.setpoint_error_rad = self.setpoint_error_rad.max((sensed.echo - on_plan).amax());
            }
            let next = cycle.executed().then(answer.q);
            self.acceleration_radps2 = self.acceleration_radps2.max(next.ddq().amax());
            let jerk = (next.ddq() - cycle.executed().ddq()).amax() / CYCLE_S;
            self.jerk_radps3 = self.jerk_radps3.max(jerk);
            self.rejoin_cycles = self.rejoin_cycles.max(answer.rejoin_cycles);
            (self.cycles, self.lost) = (self.cycles + 1, self.lost + answer.lost);
            if env::var_os("TRACE").is_some() {
                println!("{time_s:.3} {end_s:.3} {answer:?} {:?}", ahead.peek().is_none());
            }
            let mut q = JointPositions::new(std::array::from_fn(|i| answer.q[i]));
            q.motion_finished = ahead.peek().is_none() && time_s > end_s + 0.05 && answer.rejoin_cycles == 0;
            control.write_once(&q, None)?;
            if q.motion_finished {
                return Ok(());
            }
            state = control.read_once()?.0;
        }
    }

    /// A throw from wherever the arm is; a reflex is followed by an error recovery.
    fn throws(&mut self, robot: &Robot, throw: &Throw) {
        let arms = throw.arms();
        self.throws += 1;
        if let Err(fault) = self.moves(robot, &arms, |from| throw.from(from, &arms[0])) {
            self.reflexes += 1;
            assert!(fault.to_string().contains("reflex"), "{fault}");
            println!("  throw {}: {}", self.throws, fault.to_string().lines().next().unwrap_or_default());
            robot.automatic_error_recovery().unwrap();
        }
    }
}

fn run(scale: &str, more: &[&str]) -> Figures {
    let throws = Throw::all(scale);
    let server = Server::start(&throws[0].ready_q, more);
    let robot = server.connect();
    let mut figures = Figures::default();
    for throw in &throws {
        figures.throws(&robot, throw);
    }
    figures.told(&format!("{scale} of the acceleration limit, {}", more.join(" ")));
    figures
}

/// Of `every` answers so many are lost, `together`.
fn with_losses(scale: &str, together: usize, every: usize) -> Figures {
    run(scale, &[&format!("--lose={every}"), &format!("--together={together}")])
}

#[test]
#[ignore = "needs franka-sim"]
fn catch_motions_are_followed_without_a_reflex() {
    let figures = run("0.85", &[]);
    assert_eq!((figures.reflexes, figures.lost), (0, 0));
    assert!(figures.setpoint_error_rad <= 1e-6 && figures.jerk_radps3 <= 5000.0);
    assert!(figures.q_error_rad <= 10e-3 && figures.q_rms_rad() <= 2e-3);
}

#[test]
#[ignore = "needs franka-sim"]
fn losses_within_the_margin_are_survived() {
    for (together, every) in [(1, 101), (2, 53)] {
        assert_eq!(margin::acceleration_ratio(together as u64), Some(0.85));
        let figures = with_losses("0.85", together, every);
        assert_eq!(figures.reflexes, 0);
        assert!(figures.lost > 0 && figures.jerk_radps3 <= 5000.0);
    }
}

/// Reflexes against the fraction of the acceleration limit, for runs of two.
#[test]
#[ignore = "needs franka-sim"]
fn without_a_margin_two_in_a_row_end_in_a_reflex() {
    let reflexes = ["1.0", "0.95", "0.9", "0.85"].map(|scale| with_losses(scale, 2, 53).reflexes);
    assert!(reflexes[0] > 0 && reflexes[3] == 0, "{reflexes:?}");
}

/// Longer runs than the margin is for may end in a reflex; the next throw begins after an error recovery.
#[test]
#[ignore = "needs franka-sim"]
fn three_in_a_row_stop_by_the_rules_and_restart() {
    assert_eq!(margin::acceleration_ratio(3), None);
    let figures = with_losses("1.0", 3, 53);
    assert!(figures.reflexes > 0 && figures.reflexes <= figures.throws);
}

/// The controller stops after twenty, and takes the next motion after an error recovery.
#[test]
#[ignore = "needs franka-sim"]
fn a_silent_link_ends_the_motion_and_the_next_one_begins() {
    let throws = Throw::all("0.85");
    let server = Server::start(&throws[0].ready_q, &["--lose=500", "--together=25"]);
    let robot = server.connect();
    let mut figures = Figures::default();
    for throw in throws.iter().take(3) {
        figures.throws(&robot, throw);
    }
    figures.told("25 lost in a row");
    assert_eq!(figures.reflexes, 3);
    assert!(figures.lost > 0);
}

/// A link that holds answers back and lets them through together: the controller may stop by a reflex, which
/// it names, and the next throw is followed.
#[test]
#[ignore = "needs franka-sim"]
fn late_answers_stop_by_the_rules_and_the_next_throw_is_followed() {
    let throws = Throw::all("0.85");
    for (throw, late) in throws.iter().cycle().zip([1, 2, 3, 5, 10, 20]) {
        let server = Server::start(&throw.ready_q, &["--lose=600", &format!("--late={late}")]);
        let robot = server.connect();
        let [mut held, mut after] = [Figures::default(), Figures::default()];
        held.throws(&robot, throw);
        held.told(&format!("{late} answers held, the first for {late} ms"));
        after.throws(&robot, throw);
        assert!(held.lost > 0 || held.reflexes > 0, "nothing was late");
        assert_eq!((after.reflexes, after.lost), (0, 0));
    }
}
