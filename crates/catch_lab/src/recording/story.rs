//! The story of a throw whose truth is known: with its release, its contact and its end.

use catch_recording::{
    Tick,
    timeline::{Entry, Event, Timeline},
};
use catch_sim::{Truth, TruthSample};

use crate::referee::Verdict;

/// Follows a trial and tells its story.
#[derive(Debug, Default)]
pub struct Story {
    timeline: Timeline,
    samples_seen: usize,
    /// Time of the release on the clock of the true states.
    released_s: f64,
    touched: bool,
}

impl Story {
    /// The story of a throw that is released at `released_s` on the clock of the true states; its own is zero
    /// then.
    pub fn since(released_s: f64) -> Self {
        Self { released_s, ..Self::default() }
    }

    /// Takes note of a tick and of the true motion so far; returns what can be told now.
    pub fn ticked(&mut self, tick: &Tick, truth: &Truth) -> &[Entry] {
        let told = self.timeline.entries().len();
        if let Some(sample) = truth.samples.first().filter(|_| told == 0) {
            self.timeline.tell(sample.time_s - self.released_s, Event::Thrown, thrown(sample));
        }
        self.timeline.ticked(tick);
        let mut new = truth.samples[self.samples_seen..].iter();
        if let Some(sample) = new.find(|sample| sample.contact.gripper() && !self.touched) {
            self.touched = true;
            self.timeline.tell(sample.time_s - self.released_s, Event::Contact, touched_by(sample));
        }
        self.samples_seen = truth.samples.len();
        &self.timeline.entries()[told..]
    }

    /// The end of the story.
    pub fn ended(&mut self, verdict: &Verdict, end_s: f64) -> &[Entry] {
        let told = self.timeline.entries().len();
        match verdict.reason {
            None => self.timeline.tell(end_s, Event::Held, "squeezed, at rest in the hand, and shaken".to_owned()),
            Some(reason) => self.timeline.tell(end_s, Event::Missed, reason.to_string()),
        }
        &self.timeline.entries()[told..]
    }

    /// The whole story.
    pub fn into_entries(self) -> Vec<Entry> {
        self.timeline.into_entries()
    }
}

fn thrown(sample: &TruthSample) -> String {
    let p_WO = sample.X_WO.translation.vector;
    format!("{:.2} m/s, {:.2} m from the arm's axis", sample.V_WO.linear.norm(), libm::hypot(p_WO.x, p_WO.y))
}

fn touched_by(sample: &TruthSample) -> String {
    let parts = [
        (sample.contact.left_finger, "left finger"),
        (sample.contact.right_finger, "right finger"),
        (sample.contact.palm, "palm"),
    ];
    let parts: Vec<&str> = parts.iter().filter(|(touches, _)| *touches).map(|&(_, name)| name).collect();
    parts.join(" and ")
}
