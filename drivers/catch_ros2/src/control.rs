//! The thread that publishes plans and hears states.

use std::{
    env, fmt, thread,
    time::{Duration, Instant},
};

use anyhow::{Context as _, anyhow};
use catch_body::{InputError, JointVector, Robot as Arm};
use catch_cell::{Executor, ExecutorConfig, LimitCheck};
use catch_driver::{
    braking::{CYCLE_S, Executed},
    clock::Clock,
    control::{Control, Link, Sample},
    enabling_key::EnablingKey,
};
use ros2_client::{
    Context, ContextOptions, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Subscription,
    qos::{History, WhenFull},
};

use crate::messages::{JointState, JointTrajectory, braking, planned};

/// Longest wait for the controller to be found, and for its first state.
pub const START: Duration = Duration::from_secs(5);
/// Silence of the joint states after which the link counts as dead: their rate is that of the robot's
/// broadcaster.
pub const SILENCE: Duration = Duration::from_millis(250);
/// Interval at which states, plans and the key are looked at.
const POLL: Duration = Duration::from_millis(1);
/// Time in seconds from the end of a stop until the arm counts as standing.
const SETTLED_S: f64 = 0.1;

/// A controller, and the states of its joints.
pub struct Controller {
    node: Node,
    topic: String,
    arm: Arm,
    plans: Publisher<JointTrajectory>,
    states: Subscription<JointState>,
}

impl fmt::Debug for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Controller").field("topic", &self.topic).finish_non_exhaustive()
    }
}

impl Controller {
    /// Finds a controller by its name in the domain of `ROS_DOMAIN_ID`, and the joint states beside it.
    ///
    /// # Errors
    /// A name that is none; a controller that is not there.
    pub fn connect(name: &str, arm: &Arm) -> anyhow::Result<Self> {
        let domain = env::var("ROS_DOMAIN_ID").ok().filter(|it| !it.is_empty());
        let expected = "a number from 0 to 232";
        let domain = domain.map_or(Ok(0), |it| {
            it.parse().map_err(|_| InputError::new("the environment", "ROS_DOMAIN_ID", format!("{it:?}"), expected))
        })?;
        let name = &format!("/{}", name.trim_start_matches('/'));
        let space = name.rsplit_once('/').map_or("", |it| it.0);
        let context = Context::with_options(ContextOptions::new().domain_id(domain)).map_err(|it| anyhow!("{it}"))?;
        let node_name = NodeName::new("/", "catchingbot").map_err(|it| anyhow!("{it:?}"))?;
        let mut node = context.new_node(node_name, NodeOptions::new().enable_rosout(false))?;
        let plans_qos = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::DEFAULT)
            .history(History::KeepLast { depth: 1 });
        let states_qos =
            QosProfile::subscription_default().reliability_best_effort().history(History::KeepLast { depth: 8 });
        let (topic, states) = (format!("{name}/joint_trajectory"), format!("{space}/joint_states"));
        let named = |it: &str| Name::parse(it).map_err(|fault| anyhow!("the controller {it}: {fault:?}"));
        let of_plans =
            node.create_topic(&named(&topic)?, MessageTypeName::new("trajectory_msgs", "JointTrajectory"), &plans_qos)?;
        let of_states =
            node.create_topic(&named(&states)?, MessageTypeName::new("sensor_msgs", "JointState"), &states_qos)?;
        let plans = node.create_publisher(&of_plans, None)?;
        let states = node.create_subscription(&of_states, None)?;
        let controller = Self { node, topic, arm: arm.clone(), plans, states };
        controller.found().with_context(|| format!("the arm at {name}"))?;
        Ok(controller)
    }

    /// Waits until the controller listens.
    fn found(&self) -> anyhow::Result<()> {
        let began = Instant::now();
        while self.node.subscription_count(&self.topic) == 0 {
            if began.elapsed() > START {
                return Err(anyhow!(
                    "nobody listens to {}: is the controller active, in this ROS_DOMAIN_ID?",
                    self.topic
                ));
            }
            thread::sleep(POLL);
        }
        Ok(())
    }

    /// The newest state that has come since the last one; none if none has.
    fn newest(&self) -> Option<[JointVector; 2]> {
        let mut newest = None;
        while let Ok(Some((state, _))) = self.states.take() {
            newest = state.of(&self.arm).or(newest);
        }
        newest
    }

    /// Waits for the next state: positions and velocities of the arm's joints.
    ///
    /// # Errors
    /// If none comes in time.
    pub fn next_state(&self, within: Duration) -> Result<[JointVector; 2], String> {
        let began = Instant::now();
        loop {
            if let Some(state) = self.newest() {
                return Ok(state);
            }
            if began.elapsed() > within {
                return Err(format!("no joint states of {}", self.arm.joints[0].name));
            }
            thread::sleep(POLL);
        }
    }

    fn publish(&self, message: JointTrajectory) -> Result<(), String> {
        self.plans.publish(message).map_err(|fault| fault.to_string())
    }
}

/// Begins a motion: the controller executes plans while `key` is held.
pub fn begin(controller: Controller, arm: Arm, key: EnablingKey, clock: Clock) -> Control {
    Control::begin(key, clock, SILENCE, move |link| follow(&controller, &arm, link))
}

/// Publishes plans until the arm has stopped.
fn follow(controller: &Controller, arm: &Arm, link: &Link) -> Result<(), String> {
    let [q, dq] = controller.next_state(START)?;
    let began_s = link.clock.now_s();
    // Whoever hands over a plan has checked it.
    let unchecked = ExecutorConfig {
        continuous_start: false,
        continuous_inside: false,
        ends_at_rest: false,
        limit_check: LimitCheck::Off,
    };
    let mut plans = Executor::new(arm.clone(), q, unchecked);
    let mut sample = Sample {
        time_s: 0.0,
        heard_s: began_s,
        q,
        dq,
        echo: q,
        lost: 0,
        missed: 0,
        success_rate: 1.0,
        answer_s: 0.0,
        has_stopped: false,
    };
    link.tell(sample);
    let mut stops_s = None;
    loop {
        let heard_s = link.clock.now_s();
        let time_s = heard_s - began_s;
        plans.advance(time_s - 3.0 * CYCLE_S);
        if let Some([q, dq]) = controller.newest() {
            sample = Sample { time_s, heard_s, q, dq, echo: plans.setpoint(time_s).q, ..sample };
            link.tell(sample);
        }
        for plan in link.plans.try_iter().filter(|_| stops_s.is_none()) {
            // It can only be refused for a number that a checked plan has not.
            let _ = plans.receive(&plan, plan.start_s());
            controller.publish(planned(arm, [time_s, plan.end_s()], |at_s| plans.setpoint(at_s)))?;
        }
        match stops_s {
            None if link.has_to_stop() => {
                let at = |i: i32| plans.setpoint(time_s - f64::from(i) * CYCLE_S).q;
                let stop = braking(arm, Executed([0, 1, 2].map(at)));
                let took = stop.points.last().map(|it| it.time_from_start);
                let took_s = took.map_or(0.0, |it| f64::from(it.sec) + f64::from(it.nanosec) * 1e-9);
                stops_s = Some(time_s + took_s + SETTLED_S);
                controller.publish(stop)?;
            }
            Some(stops_s) if time_s > stops_s => {
                link.tell(Sample { time_s, heard_s, has_stopped: true, ..sample });
                return Ok(());
            }
            _ => {}
        }
        thread::sleep(POLL);
    }
}
