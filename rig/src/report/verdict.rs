//! What came out, in sentences for someone who has a minute.

use ident::experiment::{Spike, Use};
use ident::fit::{Fit, FittedParameter};

use super::data::{ReportData, RunEnd};
use super::diagnosis_text;
use super::format::{counted, millimetres, percent};
use super::tone::Tone;

/// The verdict line, and sentences that qualify it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Verdict {
    pub(super) tone: Tone,
    pub(super) line: String,
    pub(super) details: Vec<String>,
}

/// The paper calls an average error below this share of the length accurate (its section III).
const ACCURATE_SHARE: f64 = 0.05;
/// Mean length of a plane vector whose two components have one sigma of 1: sqrt(pi / 2).
const MEAN_PLANE_NOISE: f64 = 1.253_314_137_315_5;
/// Up to this multiple of what noise alone would leave, an error counts as noise.
const NOISE_MARGIN: f64 = 1.3;

/// Whether errors of this keypoint go into averages: those of P0, the reference end, do not, as in the paper.
pub(super) fn is_averaged(name: &str) -> bool {
    name != "P0"
}

/// Whether the data settle a coefficient by itself, not just a combination with others.
pub(super) fn is_settled(fit: &Fit, parameter: &FittedParameter) -> bool {
    parameter.determined && !is_combined(fit, &parameter.name)
}

/// Whether only a combination of this coefficient with others is seen.
pub(super) fn is_combined(fit: &Fit, name: &str) -> bool {
    fit.unidentifiable.iter().any(|group| group.len() > 1 && group.iter().any(|member| member == name))
}

/// Below this probability a coefficient is taken to differ from run to run.
const CONSTANCY_P: f64 = 1e-3;

/// Whether all runs agree on a coefficient, as far as they were asked.
pub(super) fn is_constant(parameter: &FittedParameter) -> bool {
    parameter.constancy.is_none_or(|test| test.p >= CONSTANCY_P)
}

/// Mean over keypoints and runs of the mean errors \[m\]; `None` without such runs.
pub(super) fn mean_error_m(fit: &Fit, usage: Use) -> Option<f64> {
    let errors: Vec<f64> = fit
        .runs
        .iter()
        .filter(|run| run.usage == usage)
        .flat_map(|run| run.keypoints.iter().filter(|k| is_averaged(&k.name)).map(|k| k.mean_error_m))
        .filter(|e| e.is_finite())
        .collect();
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
}

/// Reads the verdict off the data. Its line says where it is of fewer images than were received.
pub(super) fn verdict(data: &ReportData) -> Verdict {
    let mut verdict = said(data);
    if let Some(images) = data.images.as_ref().filter(|images| images.unread > 0) {
        let read = images.received.saturating_sub(images.unread);
        verdict.tone = verdict.tone.max(Tone::Caution);
        verdict.line += &format!(" Only {read} of {} images received could be read.", images.received);
    }
    verdict
}

fn said(data: &ReportData) -> Verdict {
    match (&data.end, &data.fit, &data.diagnosis) {
        (Some(RunEnd::Abort(reason)), ..) => Verdict::plain(Tone::Bad, format!("Aborted: {reason}")),
        (Some(RunEnd::Fail(reason)), ..) => Verdict::plain(Tone::Bad, format!("Failed: {reason}")),
        (_, Some(fit), _) => of_fit(fit, data),
        (_, None, Some(figures)) => Verdict {
            tone: diagnosis_text::tone(figures.diagnosis.verdict),
            line: figures.diagnosis.sentence.clone(),
            details: diagnosis_text::details(&figures.diagnosis),
        },
        (_, None, None) => Verdict::plain(Tone::Caution, measured(data)),
    }
}

impl Verdict {
    fn plain(tone: Tone, line: String) -> Self {
        Self { tone, line, details: Vec::new() }
    }

    fn caution(&mut self, detail: String) {
        self.tone = Tone::Caution;
        self.details.push(detail);
    }
}

fn measured(data: &ReportData) -> String {
    let keypoints = data.runs.iter().map(|run| run.measured.keypoints.len()).max().unwrap_or(0);
    match &data.images {
        Some(images) => {
            format!("Filmed and measured: {} of {} images gave keypoints.", images.used, images.received)
        }
        None if keypoints > 0 => format!("Measured {}; no model was fitted.", counted(keypoints, "keypoint")),
        None => "Nothing was measured.".into(),
    }
}

fn of_fit(fit: &Fit, data: &ReportData) -> Verdict {
    let length = fit.characteristic_length_m;
    let (fitted, heldout) = (mean_error_m(fit, Use::Fit), mean_error_m(fit, Use::Holdout));
    let worst = fitted.into_iter().chain(heldout).fold(0.0, f64::max);
    let tone = if fitted.or(heldout).is_none() { Tone::Bad } else { Tone::Good };
    let mut verdict = Verdict::plain(tone, follows(fitted, heldout, length));
    if length > 0.0 && worst > ACCURATE_SHARE * length {
        verdict.caution("More than 5 % of the length: the paper would not call this accurate.".into());
    }
    if fit.noise_m > 0.0 && worst > 0.0 {
        verdict.details.push(beside_noise(worst / (MEAN_PLANE_NOISE * fit.noise_m), fit.noise_m));
    }
    if let Some(figures) = &data.diagnosis {
        verdict.details.push(format!("Diagnosis: {}", figures.diagnosis.sentence));
    }
    if let (Some(fitted), Some(heldout)) = (fitted, heldout)
        && heldout > 2.0 * fitted
    {
        let ratio = heldout / fitted;
        verdict.caution(format!("Held-out runs are predicted {ratio:.1} times worse than the fitted ones."));
    }
    let set_aside = fit.runs.iter().filter_map(|run| Spike::sentence(&run.id, &run.set_aside));
    verdict.details.extend(set_aside.map(|sentence| format!("{sentence}.")));
    verdict.details.extend(on_coefficients(fit));
    for (run, touch) in fit.runs.iter().filter_map(|run| Some((run, run.touch.as_ref()?))) {
        verdict.caution(format!("In the simulation of {}, {touch}.", run.id));
    }
    let elsewhere = fit.starts.iter().filter(|start| !start.agrees).count();
    if elsewhere > 0 {
        verdict.details.push(format!(
            "{elsewhere} of {} of the search ended elsewhere: there are other optima, of which the best counts.",
            counted(fit.starts.len(), "start")
        ));
    }
    verdict
}

/// How well the model follows the keypoints, by the mean errors \[m\] of fitted and held-out runs.
fn follows(fitted: Option<f64>, heldout: Option<f64>, length_m: f64) -> String {
    let say = |error: f64| {
        format!("{} mm ({} % of {:.0} mm)", millimetres(error), percent(error, length_m), length_m * 1e3)
    };
    match (fitted, heldout) {
        (Some(fitted), Some(heldout)) => format!(
            "The calibrated model follows the keypoints to {} where it was fitted and to {} on held-out runs.",
            say(fitted),
            say(heldout)
        ),
        (Some(error), None) => {
            format!("The calibrated model follows the keypoints to {} on average.", say(error))
        }
        (None, Some(error)) => format!("The model predicts the held-out runs to {} on average.", say(error)),
        (None, None) => "The fit left no error that could be scored.".into(),
    }
}

/// What an error of `ratio` times what noise alone would leave means.
fn beside_noise(ratio: f64, noise_m: f64) -> String {
    let noise = format!("({} mm, 1 σ per axis)", millimetres(noise_m));
    if ratio <= NOISE_MARGIN {
        return format!(
            "This is what keypoint noise alone leaves {noise}: the data see no fault in the model."
        );
    }
    format!(
        "The error is {ratio:.1} times what keypoint noise alone would leave {noise}: the model misses something that \
         the residuals show."
    )
}

/// Which coefficients are not to be read as measured.
fn on_coefficients(fit: &Fit) -> Vec<String> {
    let mut details = Vec::new();
    let loose = fit.parameters.iter().filter(|p| !is_settled(fit, p)).count();
    let bound = fit.parameters.iter().filter(|p| p.at_bound).count();
    if loose > 0 {
        details.push(format!(
            "{loose} of {} left open by these runs: do not read their values as measured.",
            counted(fit.parameters.len(), "coefficient") + if loose == 1 { " is" } else { " are" },
        ));
    }
    if bound > 0 {
        let rests = if bound == 1 { "coefficient rests" } else { "coefficients rest" };
        details.push(format!("{bound} {rests} on a bound."));
    }
    let drifting: Vec<&str> =
        fit.parameters.iter().filter(|p| !is_constant(p)).map(|p| p.name.as_str()).collect();
    if !drifting.is_empty() {
        details.push(format!(
            "The runs do not agree on {}: there it stands in for something that differs from run to run.",
            drifting.join(", ")
        ));
    }
    details
}
