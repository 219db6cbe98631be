//! The command on its way to the drives, through the causes between: see [`super::drive`].

use super::drive::stage::{Piece, StageState};
use super::{STAGES, Stages};
use crate::command::Command;
use crate::model::Model;
use crate::scalar::{Mask, Scalar, tuned};

/// The commands as a model's drives get them: those of the servos, altered by the causes between.
#[derive(Debug, Clone)]
pub struct CommandPath<T: Scalar> {
    stages: Stages<T>,
    /// Row times \[s\].
    time_s: Vec<f64>,
    /// Per actuator of the model; `None` without a command.
    tracks: Vec<Option<Track<T>>>,
}

#[derive(Debug, Clone)]
struct Track<T: Scalar> {
    /// Commanded angle in each row; while the drive is idle, the last one.
    angle: Vec<f64>,
    /// From when to when it is idle \[s\].
    idle: Vec<[f64; 2]>,
    /// What each stage keeps at each row; empty without stages.
    states: Vec<[StageState<T>; STAGES]>,
}

impl<T: Scalar> Track<T> {
    /// The commands `angle` at `time_s`, some of which may be no number.
    fn new(mut angle: Vec<f64>, time_s: &[f64]) -> Self {
        let mut idle: Vec<[f64; 2]> = Vec::new();
        let mut last = angle.iter().copied().find(|angle| !angle.is_nan()).unwrap_or(0.0);
        for (row, angle) in angle.iter_mut().enumerate() {
            if angle.is_nan() {
                *angle = last;
                let to_s = time_s.get(row + 1).copied().unwrap_or(f64::INFINITY);
                match idle.last_mut().filter(|[_, until_s]| *until_s == time_s[row]) {
                    Some([_, until_s]) => *until_s = to_s,
                    None => idle.push([time_s[row], to_s]),
                }
            }
            last = *angle;
        }
        Self { angle, idle, states: Vec::new() }
    }
}

impl<T: Scalar> CommandPath<T> {
    /// `command` on its way to the drives of `model`; actuators without a column are commanded 0.
    pub fn new(model: &Model<T>, command: &Command) -> Self {
        let stages = Stages::new(model);
        let width = command.actuators.len();
        let tracks = model.actuators.iter().map(|actuator| {
            let column = command.actuators.iter().position(|name| *name == actuator.name)?;
            let angle = command.angle_rad.iter().skip(column).step_by(width).copied().collect();
            Some(Track::new(angle, &command.time_s))
        });
        let mut path = Self { tracks: tracks.collect(), time_s: command.time_s.clone(), stages };
        if !path.stages.is_empty() {
            path.refine(1);
            for drive in 0..path.tracks.len() {
                path.follow(drive);
            }
        }
        path
    }

    /// Adds a row: from `time_s` on the command is `angle_rad`, shape (actuators with a command, in the model's order),
    /// and went there straight from the row before. For commands that come in while a mechanism moves.
    ///
    /// # Panics
    /// When the time does not rise, or when there are not as many angles as commanded actuators.
    pub fn push(&mut self, time_s: f64, angle_rad: &[f64]) {
        assert!(self.time_s.last().is_none_or(|&last| last < time_s), "rows rise in time");
        let commanded = self.tracks.iter().flatten().count();
        assert_eq!(angle_rad.len(), commanded, "one angle for each commanded actuator");
        self.time_s.push(time_s);
        for (track, &angle) in self.tracks.iter_mut().flatten().zip(angle_rad) {
            track.angle.push(angle);
        }
        if !self.stages.is_empty() {
            self.refine(self.time_s.len() - 1);
            for drive in 0..self.tracks.len() {
                self.follow(drive);
            }
        }
    }

    /// Longest step that follows it \[s\].
    pub(crate) fn longest_step_s(&self) -> f64 {
        self.stages.longest_step_s()
    }

    /// Puts rows between those from row `first` on and the ones before them, where these are further apart than the stages can bear.
    fn refine(&mut self, first: usize) {
        let longest_s = self.stages.longest_piece_s();
        if longest_s.is_infinite() || first >= self.time_s.len() {
            return;
        }
        let rows = first.max(1)..self.time_s.len();
        // how much of the way from the row before
        let parts: Vec<(usize, f64)> = rows
            .clone()
            .flat_map(|row| {
                let count = ((self.time_s[row] - self.time_s[row - 1]) / longest_s).ceil().max(1.0) as usize;
                (1..=count).map(move |part| (row, part as f64 / count as f64))
            })
            .collect();
        let refined = |values: &mut Vec<f64>| {
            let between = |&(row, share): &(usize, f64)| {
                let (from, to) = (values[row - 1], values[row]);
                if share == 1.0 { to } else { from + share * (to - from) }
            };
            let more: Vec<f64> = parts.iter().map(between).collect();
            values.truncate(rows.start);
            values.extend(more);
        };
        refined(&mut self.time_s);
        self.tracks.iter_mut().flatten().for_each(|track| refined(&mut track.angle));
    }

    /// What the model's actuator `drive` gets at `time_s`; 0 without a command, no number where it is idle.
    pub fn at(&self, drive: usize, time_s: f64) -> T {
        let Some(track) = &self.tracks[drive] else { return T::ZERO };
        let Some(last) = self.time_s.len().checked_sub(1) else { return T::ZERO };
        if track.idle.iter().any(|[from_s, to_s]| (*from_s..*to_s).contains(&time_s)) {
            return T::from_f64(f64::NAN);
        }
        let row = self.time_s.partition_point(|&t| t <= time_s).saturating_sub(1);
        if self.stages.is_empty() {
            return T::from_f64(self.straight(track, row, time_s));
        }
        tuned!(T, self.after_stages(track, row, last, time_s))
    }

    /// What comes out of all stages at `time_s`, which is after row `row`.
    #[inline(always)]
    fn after_stages(&self, track: &Track<T>, mut row: usize, last: usize, time_s: f64) -> T {
        let given = self.stages.given(T::from_f64(time_s));
        // lanes may have been given their command in other rows
        let mut first = row;
        while first > 0 && given.less(T::from_f64(self.time_s[first])).any() {
            first -= 1;
        }
        while row < last && !given.less(T::from_f64(self.time_s[row + 1])).all() {
            row += 1;
        }
        let mut value = T::ZERO;
        for row in first..=row {
            let before = given.less(T::from_f64(self.time_s[row]));
            let here = self.passed(track, row, given);
            value = if row == first { here } else { T::select(before, value, here) };
        }
        value
    }

    /// The command as given, straight between rows.
    fn straight(&self, track: &Track<T>, row: usize, time_s: f64) -> f64 {
        let value = track.angle[row];
        match self.time_s.get(row + 1) {
            // of two rows at one time the first is never asked for
            Some(&after) if time_s >= self.time_s[row] => {
                let before = self.time_s[row];
                value + (time_s - before) / (after - before) * (track.angle[row + 1] - value)
            }
            _ => value,
        }
    }

    /// What comes out `given` after row `row`, before the next.
    #[inline(always)]
    fn passed(&self, track: &Track<T>, row: usize, given: T) -> T {
        let duration = (given - T::from_f64(self.time_s[row])).max(T::ZERO);
        let mut states = track.states[row];
        let from = track.angle[row];
        let slope = match self.time_s.get(row + 1) {
            Some(&after) if after > self.time_s[row] => {
                (track.angle[row + 1] - from) / (after - self.time_s[row])
            }
            _ => 0.0,
        };
        let to = T::from_f64(from) + duration * T::from_f64(slope);
        let start_s = T::from_f64(self.time_s[row]);
        self.stages.pass(&mut states, Piece { from: T::from_f64(from), to, start_s, duration });
        states[STAGES - 1].end
    }

    /// Works out what the stages hand on at the rows where it is not known yet.
    fn follow(&mut self, drive: usize) {
        let Some(track) = &mut self.tracks[drive] else { return };
        tuned!(T, {
            while track.states.len() < self.time_s.len() {
                let row = track.states.len();
                let to = T::from_f64(track.angle[row]);
                let states = match row.checked_sub(1) {
                    None => self.stages.steady(to),
                    // a jump takes no time, and what has inertia stays where it is
                    Some(before) if self.time_s[row] == self.time_s[before] => track.states[before],
                    Some(before) => {
                        let from = T::from_f64(track.angle[before]);
                        let duration = T::from_f64(self.time_s[row] - self.time_s[before]);
                        let mut states = track.states[before];
                        let start_s = T::from_f64(self.time_s[before]);
                        self.stages.pass(&mut states, Piece { from, to, start_s, duration });
                        states
                    }
                };
                track.states.push(states);
            }
        });
    }
}
