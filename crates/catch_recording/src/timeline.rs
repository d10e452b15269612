//! The story of a throw: what happened when, as it happens.

use catch_bot::perception::CameraStatus;
use serde::{Deserialize, Serialize};

use crate::{name_of, tick::Tick};

/// Event of a throw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The object leaves the thrower's hand.
    Thrown,
    /// The brain found a camera to be at fault, or right again.
    Camera,
    /// The brain has its first pose of the object.
    FirstSeen,
    /// The brain has its first trajectory of the object.
    FirstTrajectory,
    /// The brain has its first plan of a catch.
    FirstPlan,
    /// The brain changed its plan, once or more often.
    Replanned,
    /// The fingers start to close.
    Closing,
    /// The object touches the gripper.
    Contact,
    /// The object has stayed in the gripper, also while the world shook.
    Held,
    /// The object was not caught.
    Missed,
}

impl Event {
    /// Returns the name of the event for people.
    pub fn label(self) -> String {
        name_of(self).replace('_', " ")
    }
}

/// One line of the story.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Time of the event, or of its first occurrence.
    pub time_s: f64,
    /// Kind of event.
    pub event: Event,
    /// Number of occurrences, for events that can happen more than once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// More about it, for people.
    pub detail: String,
}

/// Follows a brain and tells its story.
#[derive(Debug, Default)]
pub struct Timeline {
    entries: Vec<Entry>,
    /// Replans since the last entry; they are told as one.
    replans: Option<Entry>,
    /// Last status of each camera.
    cameras: Vec<CameraStatus>,
    seen: bool,
    predicted: bool,
    planned: bool,
    closing: bool,
}

impl Timeline {
    /// Takes note of what the brain did in a tick.
    pub fn ticked(&mut self, tick: &Tick) {
        let Some(report) = tick.report else { return };
        let now = tick.observation.time_s;
        self.cameras.resize(report.cameras.len(), CameraStatus::Good);
        for (camera, status) in report.cameras.iter().enumerate() {
            if std::mem::replace(&mut self.cameras[camera], *status) != *status {
                self.tell(now, Event::Camera, format!("number {camera}: {status}"));
            }
        }
        if let Some(pose) = report.pose.as_ref().filter(|_| !self.seen) {
            self.seen = true;
            self.tell(now, Event::FirstSeen, format!("{} points on its surface", pose.points));
        }
        if let Some(flight) = report.flight.as_ref().filter(|_| !self.predicted) {
            self.predicted = true;
            self.tell(now, Event::FirstTrajectory, format!("{} poses agree", flight.inliers));
        }
        if let Some(plan) = &report.plan {
            let detail = format!(
                "catch at {:.3} s, at {:.0} % of the object's speed",
                plan.catch_s,
                plan.speed_fraction * 100.0
            );
            if !self.planned {
                self.planned = true;
                self.tell(now, Event::FirstPlan, detail);
            } else if report.status.is_new_motion() {
                let (count, since) = self.replans.as_ref().map_or((0, now), |it| (it.count.unwrap_or(0), it.time_s));
                let count = count + 1;
                let times = if count == 1 { "once".to_owned() } else { format!("{count} times until {now:.3} s") };
                let detail = format!("{times}; {detail}");
                self.replans = Some(Entry { time_s: since, event: Event::Replanned, count: Some(count), detail });
            }
        }
        if let Some(closing) = report.closing.filter(|it| it.start_s <= now && !self.closing) {
            self.closing = true;
            let width_mm = report.plan.as_ref().map_or(0.0, |plan| plan.aperture_m * 1e3);
            let detail = format!("from {width_mm:.0} mm, contact expected at {:.3} s", closing.contact_s);
            self.tell(closing.start_s, Event::Closing, detail);
        }
    }

    /// The whole story, without an end where that is unknown.
    pub fn into_entries(mut self) -> Vec<Entry> {
        self.entries.extend(self.replans.take());
        self.entries
    }

    /// The whole story so far.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Adds what happened.
    pub fn tell(&mut self, time_s: f64, event: Event, detail: String) {
        self.entries.extend(self.replans.take());
        self.entries.push(Entry { time_s, event, count: None, detail });
    }
}
