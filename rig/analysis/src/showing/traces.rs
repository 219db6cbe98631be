//! Angles and keypoints over the last seconds.

use std::collections::VecDeque;

use serde::Serialize;
use utoipa::ToSchema;

use super::picture::rounded;

/// Length of the traces \[s\]. Chosen.
const TRACE_LENGTH_S: f64 = 20.0;
/// Least time between two instants of a trace \[s\]. Chosen.
const TRACE_INTERVAL_S: f64 = 0.08;

/// The last 20 s of one quantity: lines that share their instants.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Traces {
    /// The quantity: `angle`, or an axis of the plane of motion.
    pub quantity: String,
    /// `rad` or `m`.
    pub unit: &'static str,
    /// Instants since the run began \[s\].
    pub time_s: Vec<f64>,
    /// One line for each servo or keypoint.
    pub lines: Vec<Line>,
}

/// The values of one servo or keypoint.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Line {
    /// Name of the servo or keypoint.
    pub name: String,
    /// The value at each instant; `null` where it was not observed.
    pub values: Vec<Option<f64>>,
}

/// Values in the order they arrive, of which the last seconds are stored.
#[derive(Debug, Default)]
pub(super) struct Window {
    rows: VecDeque<(f64, Vec<f64>)>,
}

impl Window {
    /// Adds the values at `time_s`, unless that is too soon after the last; a time before the last clears the trace.
    pub(super) fn push(&mut self, time_s: f64, values: impl FnOnce() -> Vec<f64>) {
        match self.rows.back() {
            Some((last, _)) if time_s < *last => self.rows.clear(),
            Some((last, _)) if time_s < last + TRACE_INTERVAL_S => return,
            _ => {}
        }
        self.rows.push_back((time_s, values()));
        while self.rows.front().is_some_and(|(first, _)| *first < time_s - TRACE_LENGTH_S) {
            self.rows.pop_front();
        }
    }

    /// Time from which the next value is stored \[s\].
    pub(super) fn next_s(&self) -> Option<f64> {
        self.rows.back().map(|(last, _)| last + TRACE_INTERVAL_S)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Lines called `names`; line `i` is column `pick(i)` of the rows, rounded to multiples of `1 / parts`.
    pub(super) fn lines(
        &self,
        quantity: &str,
        unit: &'static str,
        names: &[String],
        parts: f64,
        pick: impl Fn(usize) -> usize,
    ) -> Traces {
        let value = |values: &[f64], i: usize| values.get(pick(i)).copied().filter(|value| value.is_finite());
        let line = |(i, name): (usize, &String)| Line {
            name: name.clone(),
            values: self.rows.iter().map(|(_, values)| value(values, i).map(|v| rounded(v, parts))).collect(),
        };
        Traces {
            quantity: quantity.into(),
            unit,
            time_s: self.rows.iter().map(|(time_s, _)| rounded(*time_s, 1e3)).collect(),
            lines: names.iter().enumerate().map(line).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_seconds_are_stored_and_no_more_of_them_than_can_be_seen() {
        let mut window = Window::default();
        for k in 0..6000 {
            window.push(f64::from(k) * 0.005, || vec![f64::from(k), f64::NAN]);
        }
        let traces = window.lines("angle", "rad", &["a".into(), "b".into()], 1e3, |i| i);
        assert!((200..=251).contains(&traces.time_s.len()), "{}", traces.time_s.len());
        assert!(traces.time_s[0] > 9.9 && *traces.time_s.last().unwrap() > 29.9, "{:?}", traces.time_s);
        assert!(traces.lines[0].values.iter().all(Option::is_some));
        assert!(traces.lines[1].values.iter().all(Option::is_none), "one that was not seen");
        window.push(0.0, || vec![1.0]);
        assert_eq!(window.lines("angle", "rad", &["a".into()], 1e3, |i| i).time_s, [0.0], "another film");
    }
}
