//! What is known of a job, and how it is told.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde::Serialize;
use utoipa::ToSchema;

use super::picture::rounded;
use super::servo::{Clock, Servo};
use super::traces::{Traces, Window};
use super::{Filming, Found, Overlay, Picture, Slots, Standing, Told};
use camera::calibration::View;
use ground::clock::MonotonicNs;
use images::TimedImage;
use record::recording::Behind;
use run::film::ImageCount;

/// A picture with keypoints is shown in place of a newer one without as long as it is no older \[s\].
const OLDEST_FOUND_S: f64 = 2.0;
/// Images a second are counted over so long.
const RATE_OVER: Duration = Duration::from_secs(2);
/// Points of a fit's curve; of more, every second one is left out.
const MOST_POINTS: usize = 240;

/// All that is shown of a job at an instant.
#[derive(Debug, Serialize, ToSchema)]
pub struct Snapshot<'a> {
    /// The job.
    pub job: i64,
    /// The run that is, or was, filmed: what is told of a job is of one run, and nothing of an earlier one is in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<&'a str>,
    /// What goes on.
    pub stage: &'a str,
    /// How many of how many steps of it are done, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<[u64; 2]>,
    /// The newest picture; left out where it is still the one before, for two seconds at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<Picture>,
    /// The last 20 s of angles and keypoints.
    pub traces: Vec<Traces>,
    /// Of a run that is, or was, filmed: what came, what was lost, and how its clocks go.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub figures: Option<Figures>,
    /// The newest fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<&'a FitCurve>,
}

/// What came, what was lost, and how clocks go.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Figures {
    /// Images received.
    pub received: u64,
    /// Images that the camera counted and never handed over.
    pub lost: u64,
    /// Images marked as damaged, or not whole.
    pub damaged: u64,
    /// Images whose bytes are those of the one before.
    pub repeated: u64,
    /// Images stamped not later than the one before.
    pub stale: u64,
    /// Images a second, over the last two, while they come.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Images a second that the camera has promised.
    pub promised_fps: f64,
    /// What waits for the disk \[MiB\].
    pub waiting_mib: usize,
    /// What may wait before images are lost \[MiB\].
    pub queue_mib: usize,
    /// How far the keypoints are behind the camera, while it films \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub behind_s: Option<f64>,
    /// The servo board's clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<Clock>,
    /// How much later than planned the motion began \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_late_s: Option<f64>,
}

/// How a fit came to where it is.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct FitCurve {
    /// Which fit.
    pub name: &'static str,
    /// `search` or `descent`.
    pub phase: &'static str,
    /// Parameter vectors tried so far.
    pub evaluations: u64,
    /// The most there will be.
    pub max_evaluations: u64,
    /// After so many evaluations, the best root mean square of the keypoints' errors \[m\], over all images.
    pub curve: Vec<(u64, f64)>,
    /// The same over the fewer images of the first part of the motion, on which a descent goes most of its way.
    pub rough: Vec<(u64, f64)>,
    /// Where the parameters are, SI.
    pub parameters: Vec<Value>,
}

/// A parameter's value.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Value {
    /// Its name, for example `g3/blunt`.
    pub name: String,
    /// Its value, in its own unit.
    pub value: f64,
}

/// What is known of one job so far.
#[derive(Debug)]
pub(super) struct State {
    job: i64,
    stage: String,
    steps: Option<[u64; 2]>,
    filming: Option<Filming>,
    /// Images still come.
    rolls: bool,
    counted: Option<(ImageCount, Behind)>,
    /// Images received by when.
    received: VecDeque<(Instant, u64)>,
    servo: Servo,
    names: Vec<String>,
    view: View,
    placed: Window,
    /// When the newest image was taken, and the newest one with keypoints \[s\].
    filmed_s: Option<f64>,
    placed_s: Option<f64>,
    picture: Option<Picture>,
    fit: Option<FitCurve>,
}

impl State {
    pub(super) fn new(job: i64) -> Self {
        Self {
            job,
            stage: "starting".into(),
            steps: None,
            filming: None,
            rolls: false,
            counted: None,
            received: VecDeque::new(),
            servo: Servo::default(),
            names: Vec::new(),
            view: View::default(),
            placed: Window::default(),
            filmed_s: None,
            placed_s: None,
            picture: None,
            fit: None,
        }
    }

    /// Takes in what was told.
    pub(super) fn hear(&mut self, told: Told) {
        match told {
            Told::Film(filming) => {
                *self = Self { filming: Some(*filming), rolls: true, ..Self::new(self.job) };
            }
            Told::Stage(name, steps) => {
                (self.stage, self.steps) = (name, steps.map(|all| [0, all]));
            }
            Told::Step(done) => {
                if let Some([step, _]) = &mut self.steps {
                    *step = done;
                }
            }
            Told::Servo(event) => {
                if let Some(filming) = &self.filming {
                    self.servo.hear(&event, filming);
                }
            }
            Told::Command(command) => {
                self.look_at_servo();
                self.rolls &= !matches!(command, record::ServoCommand::Stop { .. });
                self.servo.tell(&command);
            }
            Told::Keypoints(names, view) => (self.names, self.view) = (names, view),
            Told::Placed(time_s, places) => {
                self.placed_s = Some(time_s);
                self.placed.take(time_s, || places.into_iter().flatten().collect());
            }
            Told::Fit(name, standing) => self.hear_fit(name, *standing),
            Told::End(_) => {}
        }
    }

    fn hear_fit(&mut self, name: &'static str, standing: Standing) {
        let Standing { phase, evaluations, max_evaluations, rms_m, is_rough, values } = standing;
        let (mut curve, mut rough) = match self.fit.take() {
            Some(fit) if fit.name == name && fit.evaluations <= evaluations => (fit.curve, fit.rough),
            _ => Default::default(),
        };
        if rms_m.is_finite() {
            add_point(if is_rough { &mut rough } else { &mut curve }, (evaluations, rms_m));
        }
        self.fit =
            Some(FitCurve { name, phase, evaluations, max_evaluations, curve, rough, parameters: values });
        if self.stage == name {
            // it ends long before that many, as a rule: how far it is, its curve says
            self.steps = None;
        }
    }

    /// Looks at what needs no telling; whether it has changed.
    pub(super) fn look(&mut self, slots: &Slots) -> bool {
        self.look_at_servo();
        let Some(counted) = slots.counted.take() else { return false };
        let now = Instant::now();
        self.received.push_back((now, counted.0.received));
        while self.received.front().is_some_and(|(at, _)| now - *at > RATE_OVER) {
            self.received.pop_front();
        }
        self.counted = Some(counted);
        true
    }

    fn look_at_servo(&mut self) {
        if let (Some(filming), true) = (&self.filming, self.rolls) {
            self.servo.look(MonotonicNs::now().seconds_since(filming.origin));
        }
    }

    /// A picture that is newer than the last one; with `again` that one, where there is none.
    pub(super) fn picture(&mut self, slots: &Slots, again: bool) -> Option<Picture> {
        let filmed = self.filming.as_ref().zip(slots.filmed.take());
        let filmed = filmed.map(|(filming, image)| {
            (image.mid_exposure.seconds_since(filming.origin), image, filming.origin)
        });
        if let Some((time_s, ..)) = &filmed {
            self.filmed_s = Some(*time_s);
        }
        let is_recent =
            |time_s: f64| !self.rolls || self.filmed_s.is_none_or(|now_s| now_s - time_s <= OLDEST_FOUND_S);
        let found = slots.found.take().filter(|found| is_recent(found.image.time_s));
        let newest = match (found, filmed) {
            (Some(Found { image, record }), _) => {
                let overlay = Overlay::of(&record, &self.names);
                image.grey.ok().and_then(|grey| Picture::of(&grey, image.time_s, Some(overlay)))
            }
            // the next one with keypoints comes soon
            (None, Some(_))
                if self.picture.as_ref().is_some_and(|p| p.found.is_some() && is_recent(p.time_s)) =>
            {
                None
            }
            (None, Some((time_s, image, origin))) => {
                let grey = TimedImage::of(&image, origin).grey.ok();
                grey.and_then(|grey| Picture::of(&grey, time_s, None))
            }
            (None, None) => None,
        };
        match newest {
            Some(newest) => {
                self.picture = Some(newest.clone());
                Some(newest)
            }
            None => self.picture.clone().filter(|_| again),
        }
    }

    /// All of it, with this picture, on a line of its own.
    pub(super) fn line(&self, picture: Option<Picture>) -> Vec<u8> {
        let snapshot = Snapshot {
            job: self.job,
            run: self.filming.as_ref().map(|filming| filming.run.as_str()),
            stage: &self.stage,
            steps: self.steps,
            picture,
            traces: self.traces(),
            figures: self.figures(),
            fit: self.fit.as_ref(),
        };
        // numbers and texts in lists: there is nothing in it that JSON cannot say
        let mut line = serde_json::to_vec(&snapshot).unwrap_or_default();
        line.push(b'\n');
        line
    }

    fn traces(&self) -> Vec<Traces> {
        let servo = self.filming.as_ref().and_then(|filming| filming.servo.as_ref());
        let angles = servo.into_iter().flat_map(|servo| self.servo.traces(servo));
        let axes = (0..2).filter(|_| !self.placed.is_empty()).map(|axis| {
            let (_, name) = self.view.seen_axes()[axis];
            self.placed.lines(name, "m", &self.names, 1e4, |i| 2 * i + axis)
        });
        angles.chain(axes).collect()
    }

    fn figures(&self) -> Option<Figures> {
        let (filming, (images, behind)) = (self.filming.as_ref()?, self.counted.as_ref()?);
        let fps = match (self.received.front(), self.received.back()) {
            (Some((from, before)), Some((to, now))) if to > from => {
                Some((now - before) as f64 / (*to - *from).as_secs_f64())
            }
            _ => None,
        };
        let newest_s = self.filmed_s.zip(self.placed_s).filter(|_| self.rolls);
        let behind_s = newest_s.map(|(filmed_s, placed_s)| (filmed_s - placed_s).max(0.0));
        Some(Figures {
            received: images.received,
            lost: images.lost,
            damaged: images.damaged,
            repeated: images.repeated,
            stale: images.stale,
            fps: fps.filter(|_| self.rolls).map(|fps| rounded(fps, 10.0)),
            promised_fps: filming.fps,
            waiting_mib: behind.waiting_mib,
            queue_mib: behind.queue_mib,
            behind_s: behind_s.map(|behind_s| rounded(behind_s, 100.0)),
            clock: self.servo.clock(),
            start_late_s: self.servo.start_late_s.map(|late_s| rounded(late_s, 1e6)),
        })
    }
}

/// One more point of a curve; every second one is left out where there are too many.
fn add_point(curve: &mut Vec<(u64, f64)>, point: (u64, f64)) {
    curve.push(point);
    if curve.len() > MOST_POINTS {
        let last = curve.len() - 1;
        let mut i = 0..;
        curve.retain(|_| i.next().is_some_and(|i| i % 2 == 0 || i == last));
    }
}

#[cfg(test)]
mod tests;
