//! What the golden tests share: the reference models, their runs as tables, the servo's stroke.

use std::path::PathBuf;

use sim::dual::Dual;
use sim::{Command, Model};

/// Derivatives in one pass; the simulation is compiled for this one number.
pub(crate) const DERIVATIVES_PER_PASS: usize = 6;
pub(crate) type Number = Dual<f64, DERIVATIVES_PER_PASS>;

pub(crate) fn data(file: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "data", file].iter().collect()
}

pub(crate) fn text(file: &str) -> String {
    std::fs::read_to_string(data(file)).unwrap_or_else(|error| panic!("reading {file}: {error}"))
}

pub(crate) fn model(name: &str) -> Model {
    Model::from_mjcf(&text(&format!("{name}.xml"))).unwrap()
}

/// A reference run: column names and rows.
pub(crate) struct Table {
    pub(crate) head: Vec<String>,
    pub(crate) rows: Vec<Vec<f64>>,
}

impl Table {
    pub(crate) fn read(file: &str) -> Self {
        let text = text(file);
        let mut lines = text.lines();
        let head = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        Self { head, rows }
    }

    /// The columns whose names start with `prefix`, in order.
    pub(crate) fn columns(&self, prefix: &str) -> Vec<usize> {
        (0..self.head.len()).filter(|&column| self.head[column].starts_with(prefix)).collect()
    }

    pub(crate) fn times(&self) -> Vec<f64> {
        self.rows.iter().map(|row| row[0]).collect()
    }
}

/// The bench's servo command: the stroke toward +amplitude lasts twice the stroke back; 0 at 0, rising.
pub(crate) fn stroke(time_s: f64, amplitude_rad: f64) -> f64 {
    const PERIOD_S: f64 = 1.5;
    let up = PERIOD_S * 2.0 / 3.0;
    let p = (time_s + up / 2.0).rem_euclid(PERIOD_S);
    if p < up {
        -amplitude_rad + 2.0 * amplitude_rad * p / up
    } else {
        amplitude_rad - 2.0 * amplitude_rad * (p - up) / (PERIOD_S - up)
    }
}

/// The stroke for every actuator of `model`, one row each millisecond.
pub(crate) fn stroke_command(model: &Model, amplitude_rad: f64, duration_s: f64) -> Command {
    let time_s: Vec<f64> = (0..=(duration_s * 1000.0).round() as u32).map(|k| f64::from(k) * 1e-3).collect();
    let actuators: Vec<String> = model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
    let angle_rad =
        time_s.iter().flat_map(|&t| std::iter::repeat_n(stroke(t, amplitude_rad), actuators.len())).collect();
    Command { actuators, time_s, angle_rad }
}

/// Max difference over max value.
pub(crate) fn relative(ours: &[f64], theirs: &[f64]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let difference = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let largest = theirs.iter().map(|x| x.abs()).fold(0.0, f64::max);
    if largest > 0.0 { difference / largest } else { difference }
}
