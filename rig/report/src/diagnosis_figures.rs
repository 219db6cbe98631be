//! The figures of a diagnosis: where and when residuals are large, and what they follow.

use ident::diagnose::{Diagnosed, Diagnosis, JointForce};
use ident::fit::FittedRun;
use maud::{Markup, PreEscaped, html};

use super::chart::{Chart, KEYPOINTS, MEASURED, SIMULATED, Series};

/// A diagnosis with the motions it rests on.
#[derive(Debug, Clone)]
pub struct DiagnosisFigures {
    /// As in `diagnosis.json`.
    pub diagnosis: Diagnosis,
    /// Fitted runs with the simulation of the baseline.
    pub before: Vec<FittedRun>,
    /// Fitted runs with the simulation of the named causes, or of the partial description.
    pub after: Vec<FittedRun>,
}

impl DiagnosisFigures {
    /// What there is to show of `diagnosed`.
    pub fn new(diagnosed: &Diagnosed) -> Self {
        Self {
            diagnosis: diagnosed.diagnosis.clone(),
            before: diagnosed.before.clone(),
            after: diagnosed.after.clone(),
        }
    }
}

/// Cells of a heat strip.
const STRIP_CELLS: usize = 125;
/// Times the noise at which a cell is as dark as it gets.
const DARKEST_SIGMAS: f64 = 6.0;
/// Bins of the abscissa. Chosen.
const ABSCISSA_BINS: usize = 14;
const SMALL_PX: (u32, u32) = (540, 210);

/// Distance between measured and simulated at an instant, over the root of the number of observed coordinates \[m\].
fn misfit(run: &FittedRun, instant: usize, keypoint: usize) -> Option<f64> {
    let (m, s) = (run.measured.at(instant, keypoint), run.simulated.at(instant, keypoint));
    let squares: Vec<f64> =
        (0..3).map(|axis| (m[axis] - s[axis]).powi(2)).filter(|d| d.is_finite()).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// The unknown force on a joint over its rate, a line for each of some angles, and at rest over the angle.
pub(super) fn unknown_force(force: &JointForce) -> Markup {
    let is_slide = force.unit == "N";
    let unit = if is_slide { "m" } else { "rad" };
    let line = |place: usize, x: &[f64], force: &[f64]| {
        let points = x.iter().zip(force).map(|(&x, &force)| (x, 1e6 * force)).collect();
        Series { width: 1.8, ..Series::line(points, KEYPOINTS[place % KEYPOINTS.len()]) }
    };
    let chart = |title: String, x: &str, series: Vec<Series>| Chart {
        title,
        x_label: x.to_owned(),
        y_label: if is_slide { "force [uN]" } else { "torque [uN m]" }.into(),
        size: SMALL_PX,
        series,
        ..Chart::default()
    };
    let angles: Vec<String> = force.curves.iter().map(|curve| format!("{:.2}", curve.angle)).collect();
    let moving = chart(
        format!("{}, by rate, at {} {unit}", force.joint, angles.join(", ")),
        &format!("rate [{unit}/s]"),
        force
            .curves
            .iter()
            .enumerate()
            .map(|(place, curve)| line(place, &curve.rate, &curve.force))
            .collect(),
    );
    let resting = chart(
        format!("{}, at rest", force.joint),
        &format!("angle [{unit}]"),
        vec![line(KEYPOINTS.len() - 1, &force.at_rest.angle, &force.at_rest.force)],
    );
    html! { (moving.svg()) (resting.svg()) }
}

/// One strip per run and keypoint: time to the right, darker where residuals are larger.
pub(super) fn heat(figures: &DiagnosisFigures) -> Markup {
    let noise_m = figures.diagnosis.noise_m;
    let strip = |run: &FittedRun, keypoint: usize| {
        let times = &run.measured.time_s;
        let (from, to) = (times[0], times[times.len() - 1]);
        let mut cells = vec![(0.0, 0.0); STRIP_CELLS];
        for (instant, &t) in times.iter().enumerate() {
            if let Some(misfit) = misfit(run, instant, keypoint) {
                let place = ((t - from) / (to - from).max(1e-9) * STRIP_CELLS as f64) as usize;
                let cell = &mut cells[place.min(STRIP_CELLS - 1)];
                *cell = (cell.0 + misfit * misfit, cell.1 + 1.0);
            }
        }
        let mut svg = String::new();
        for (place, (sum, count)) in cells.iter().enumerate().filter(|(_, (_, count))| *count > 0.0) {
            let ratio = (sum / count).sqrt() / noise_m;
            let dark = ((ratio - 1.0) / (DARKEST_SIGMAS - 1.0)).clamp(0.03, 1.0);
            svg.push_str(&format!(
                "<rect class=\"heat\" x=\"{place}\" y=\"0\" width=\"1.05\" height=\"10\" fill-opacity=\"{dark:.2}\"/>"
            ));
        }
        html! {
            svg.heatstrip viewBox=(format!("0 0 {STRIP_CELLS} 10")) preserveAspectRatio="none" { (PreEscaped(svg)) }
        }
    };
    html! {
        table.heatmap {
            thead { tr { th { "run" } th { "keypoint" } th { "before" } th { "after" } } }
            tbody {
                @for (before, after) in figures.before.iter().zip(&figures.after) {
                    @for (keypoint, name) in before.measured.keypoints.iter().enumerate() {
                        tr {
                            td { @if keypoint == 0 { (before.id) } }
                            td { (name) }
                            td.wide { (strip(before, keypoint)) }
                            td.wide { (strip(after, keypoint)) }
                        }
                    }
                }
            }
        }
    }
}

/// What a residual is plotted against: angle-like position, speed, acceleration of the keypoint.
fn motion(run: &FittedRun, instant: usize, keypoint: usize, axis: usize) -> Option<[f64; 3]> {
    if instant == 0 || instant + 1 >= run.simulated.time_s.len() {
        return None;
    }
    let at = |instant: usize| run.simulated.at(instant, keypoint)[axis];
    let t = |instant: usize| run.simulated.time_s[instant];
    let (a, b) = (
        (at(instant) - at(instant - 1)) / (t(instant) - t(instant - 1)),
        (at(instant + 1) - at(instant)) / (t(instant + 1) - t(instant)),
    );
    Some([at(instant), (a + b) / 2.0, 2.0 * (b - a) / (t(instant + 1) - t(instant - 1))])
}

/// Mean residuals against position, velocity, acceleration, before and after.
pub(super) fn against(figures: &DiagnosisFigures) -> Markup {
    let kinds = [("position", "mm", 1e3), ("velocity", "mm/s", 1e3), ("acceleration", "m/s²", 1.0)];
    let charts = kinds.iter().enumerate().map(|(kind, (name, unit, scale))| {
        let series = [(&figures.before, MEASURED), (&figures.after, SIMULATED)].map(|(runs, colour)| {
            let mut points: Vec<(f64, f64)> = Vec::new();
            for run in runs {
                for instant in 0..run.measured.time_s.len() {
                    for keypoint in 0..run.measured.keypoints.len() {
                        for axis in [0, 2] {
                            let r = run.measured.at(instant, keypoint)[axis]
                                - run.simulated.at(instant, keypoint)[axis];
                            if let Some(motion) =
                                motion(run, instant, keypoint, axis).filter(|_| r.is_finite())
                            {
                                points.push((motion[kind] * scale, r * 1e3));
                            }
                        }
                    }
                }
            }
            Series { width: 2.0, ..Series::line(binned(points), colour) }
        });
        Chart {
            title: format!("mean residual against {name}"),
            x_label: format!("{name} [{unit}], x and z alike"),
            y_label: "residual [mm]".into(),
            size: SMALL_PX,
            band: Some(0.25 * figures.diagnosis.noise_m * 1e3),
            series: series.into(),
            ..Chart::default()
        }
    });
    html! { @for chart in charts { (chart.svg()) } }
}

/// Means over equally many points each.
fn binned(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = points.len().div_ceil(ABSCISSA_BINS).max(1);
    let mean = |chunk: &[(f64, f64)]| {
        let n = chunk.len() as f64;
        (chunk.iter().map(|p| p.0).sum::<f64>() / n, chunk.iter().map(|p| p.1).sum::<f64>() / n)
    };
    points.chunks(size).map(mean).collect()
}

/// Amplitude of residuals by frequency, before and after.
pub(super) fn spectrum(figures: &DiagnosisFigures) -> Markup {
    let line = |runs: &[FittedRun]| {
        let frequencies: Vec<f64> = (1..100).map(|k| 0.15 * f64::from(k)).collect();
        let mut power = vec![0.0; frequencies.len()];
        let mut count: f64 = 0.0;
        for run in runs {
            for keypoint in 0..run.measured.keypoints.len() {
                for axis in [0, 2] {
                    count += 1.0;
                    let series: Vec<(f64, f64)> = (0..run.measured.time_s.len())
                        .map(|i| {
                            let r = run.measured.at(i, keypoint)[axis] - run.simulated.at(i, keypoint)[axis];
                            (run.measured.time_s[i], r)
                        })
                        .filter(|(_, r)| r.is_finite())
                        .collect();
                    for (power, hz) in power.iter_mut().zip(&frequencies) {
                        let turn = std::f64::consts::TAU * hz;
                        let (c, s) = series.iter().fold((0.0, 0.0), |(c, s), (t, r)| {
                            (c + r * (turn * t).cos(), s + r * (turn * t).sin())
                        });
                        *power += 4.0 * (c * c + s * s) / (series.len() as f64).max(1.0).powi(2);
                    }
                }
            }
        }
        frequencies.into_iter().zip(power).map(|(hz, p)| (hz, (p / count.max(1.0)).sqrt() * 1e3)).collect()
    };
    Chart {
        title: "residuals by frequency".into(),
        x_label: "frequency [Hz]".into(),
        y_label: "amplitude [mm]".into(),
        size: SMALL_PX,
        series: vec![
            Series { width: 2.0, ..Series::line(line(&figures.before), MEASURED) },
            Series { width: 1.6, ..Series::line(line(&figures.after), SIMULATED) },
        ],
        ..Chart::default()
    }
    .svg()
}
