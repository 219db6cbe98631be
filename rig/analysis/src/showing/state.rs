//! What is known of a job, and the snapshots made of it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde::Serialize;
use utoipa::ToSchema;

use super::picture::rounded;
use super::servo::{Clock, Servo};
use super::traces::{Traces, Window};
use super::{Filming, FitProgress, Found, Message, Overlay, Picture, Slots};
use camera::calibration::View;
use ground::clock::MonotonicNs;
use images::TimedImage;
use record::recording::Behind;
use run::film::ImageCount;

/// A picture with keypoints is shown in place of a newer one without until it is this old \[s\]. Chosen.
const ANNOTATED_PICTURE_MAX_AGE_S: f64 = 2.0;
/// Time over which the image rate is counted. Chosen.
const IMAGE_RATE_WINDOW: Duration = Duration::from_secs(2);
/// Points of a fit's curve at most; of more, every second one is left out. Chosen.
const CURVE_MAX_POINTS: usize = 240;

/// All that is shown of a job at an instant.
#[derive(Debug, Serialize, ToSchema)]
pub struct Snapshot<'a> {
    /// The job.
    pub job: i64,
    /// The run that is, or was, filmed. All of a snapshot belongs to this one run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<&'a str>,
    /// The stage that is under way.
    pub stage: &'a str,
    /// Steps done and all steps of the stage, where known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<[u64; 2]>,
    /// The newest picture; left out where it is still the one before, for two seconds at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<Picture>,
    /// The last 20 s of angles and keypoints.
    pub traces: Vec<Traces>,
    /// Counts of images, and clocks, of the run that is, or was, filmed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub figures: Option<Figures>,
    /// The newest fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<&'a FitCurve>,
}

/// Counts of images, amount of waiting data, and clocks.
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
    /// Images a second, over the last two seconds, while filming.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Images a second that the camera promises.
    pub promised_fps: f64,
    /// Data that wait for the disk \[MiB\].
    pub waiting_mib: usize,
    /// Data that may wait before images are lost \[MiB\].
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

/// The course of a fit so far.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct FitCurve {
    /// Name of the fit.
    pub name: &'static str,
    /// `search` or `descent`.
    pub phase: &'static str,
    /// Parameter vectors tried so far.
    pub evaluations: u64,
    /// Upper limit of the evaluations.
    pub max_evaluations: u64,
    /// After so many evaluations, the best root mean square of the keypoints' errors \[m\], over all images.
    pub curve: Vec<(u64, f64)>,
    /// The same over the fewer images of the first part of the motion, on which a descent goes most of its way.
    pub rough: Vec<(u64, f64)>,
    /// Current values of the parameters, SI.
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
    /// Whether images are still expected.
    is_filming: bool,
    counted: Option<(ImageCount, Behind)>,
    /// Times and counts of images received.
    received: VecDeque<(Instant, u64)>,
    servo: Servo,
    keypoint_names: Vec<String>,
    view: View,
    positions: Window,
    /// Times of the newest image and of the newest image with keypoints \[s\].
    last_image_s: Option<f64>,
    last_keypoints_s: Option<f64>,
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
            is_filming: false,
            counted: None,
            received: VecDeque::new(),
            servo: Servo::default(),
            keypoint_names: Vec::new(),
            view: View::default(),
            positions: Window::default(),
            last_image_s: None,
            last_keypoints_s: None,
            picture: None,
            fit: None,
        }
    }

    /// Applies a message.
    pub(super) fn apply(&mut self, message: Message) {
        match message {
            Message::Film(filming) => {
                *self = Self { filming: Some(*filming), is_filming: true, ..Self::new(self.job) };
            }
            Message::Stage(name, steps) => {
                (self.stage, self.steps) = (name, steps.map(|all| [0, all]));
            }
            Message::Step(done) => {
                if let Some([step, _]) = &mut self.steps {
                    *step = done;
                }
            }
            Message::Servo(event) => {
                if let Some(filming) = &self.filming {
                    self.servo.apply_event(&event, filming);
                }
            }
            Message::Command(command) => {
                self.extend_commanded();
                self.is_filming &= !matches!(command, record::ServoCommand::Stop { .. });
                self.servo.apply_command(&command);
            }
            Message::Keypoints(names, view) => (self.keypoint_names, self.view) = (names, view),
            Message::KeypointPositions(time_s, positions) => {
                self.last_keypoints_s = Some(time_s);
                self.positions.push(time_s, || positions.into_iter().flatten().collect());
            }
            Message::Fit(name, progress) => self.apply_fit(name, *progress),
            Message::End(_) => {}
        }
    }

    fn apply_fit(&mut self, name: &'static str, progress: FitProgress) {
        let FitProgress { phase, evaluations, max_evaluations, rms_m, is_rough, values } = progress;
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
            // a fit ends long before that many evaluations as a rule; its curve shows the progress
            self.steps = None;
        }
    }

    /// Takes over the newest counts and extends the commanded angles; whether there are new counts.
    pub(super) fn poll(&mut self, slots: &Slots) -> bool {
        self.extend_commanded();
        let Some(counted) = slots.counted.take() else { return false };
        let now = Instant::now();
        self.received.push_back((now, counted.0.received));
        while self.received.front().is_some_and(|(at, _)| now - *at > IMAGE_RATE_WINDOW) {
            self.received.pop_front();
        }
        self.counted = Some(counted);
        true
    }

    fn extend_commanded(&mut self) {
        if let (Some(filming), true) = (&self.filming, self.is_filming) {
            self.servo.extend_commanded(MonotonicNs::now().seconds_since(filming.origin));
        }
    }

    /// A picture that is newer than the last one; where there is none, with `again` the last one once more.
    pub(super) fn picture(&mut self, slots: &Slots, again: bool) -> Option<Picture> {
        let filmed = self.filming.as_ref().zip(slots.filmed.take());
        let filmed = filmed.map(|(filming, image)| {
            (image.mid_exposure.seconds_since(filming.origin), image, filming.origin)
        });
        if let Some((time_s, ..)) = &filmed {
            self.last_image_s = Some(*time_s);
        }
        let is_recent = |time_s: f64| {
            !self.is_filming
                || self.last_image_s.is_none_or(|now_s| now_s - time_s <= ANNOTATED_PICTURE_MAX_AGE_S)
        };
        let found = slots.found.take().filter(|found| is_recent(found.image.time_s));
        let newest = match (found, filmed) {
            (Some(Found { image, record }), _) => {
                let overlay = Overlay::of(&record, &self.keypoint_names);
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

    /// The snapshot with this picture, as one line of JSON.
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
        // numbers and texts in lists: JSON can hold all of it
        let mut line = serde_json::to_vec(&snapshot).unwrap_or_default();
        line.push(b'\n');
        line
    }

    fn traces(&self) -> Vec<Traces> {
        let servo = self.filming.as_ref().and_then(|filming| filming.servo.as_ref());
        let angles = servo.into_iter().flat_map(|servo| self.servo.traces(servo));
        let axes = (0..2).filter(|_| !self.positions.is_empty()).map(|axis| {
            let (_, name) = self.view.seen_axes()[axis];
            self.positions.lines(name, "m", &self.keypoint_names, 1e4, |i| 2 * i + axis)
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
        let newest_s = self.last_image_s.zip(self.last_keypoints_s).filter(|_| self.is_filming);
        let behind_s =
            newest_s.map(|(last_image_s, last_keypoints_s)| (last_image_s - last_keypoints_s).max(0.0));
        Some(Figures {
            received: images.received,
            lost: images.lost,
            damaged: images.damaged,
            repeated: images.repeated,
            stale: images.stale,
            fps: fps.filter(|_| self.is_filming).map(|fps| rounded(fps, 10.0)),
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
    if curve.len() > CURVE_MAX_POINTS {
        let last = curve.len() - 1;
        let mut i = 0..;
        curve.retain(|_| i.next().is_some_and(|i| i % 2 == 0 || i == last));
    }
}

#[cfg(test)]
mod tests;
