//! The headline of a result, one sentence and its colour, for the report, a terminal, the list of runs and the daemon's page.
//!
//! Sentence and colour come from the same few numbers: the simulation's error against the keypoints' noise, how many coefficients the
//! data determine, how many images were lost; and from the diagnosis, where there is one. Error and noise are both along one axis, so
//! that their ratio can be read directly.

use ident::diagnose::{self, Diagnosis};
use ident::experiment::Spike;
use ident::fit::{Fit, FittedParameter, NoiseSource};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::data::{ReportData, RunEnd};
use super::diagnosis_text;
use super::format::{counted, millimetres, percent};
use super::tone::Tone;
use record::losses::Losses;

/// Up to this ratio of error to noise the error counts as noise: the noise itself is uncertain by as much. Chosen.
const ERROR_AT_NOISE_RATIO: f64 = 2.0;
/// Beyond this ratio of error to noise the model does not describe the mechanism. Chosen.
const ERROR_TOO_LARGE_RATIO: f64 = 10.0;
/// Shares of lost images from which the headline mentions them, and from which it is bad. Chosen.
const LOST_IMAGES_CAUTION_SHARE: f64 = 0.01;
const LOST_IMAGES_BAD_SHARE: f64 = 0.1;
/// Below this p-value of the constancy test a coefficient is taken to differ from run to run. Chosen.
const CONSTANCY_P_VALUE: f64 = 1e-3;

/// The numbers that a headline is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Findings {
    /// Error of the simulation on the fitted runs \[m\], as in [`AxisError`](ident::loss::AxisError).
    pub error_m: Option<f64>,
    /// The same on held-out runs \[m\].
    pub holdout_error_m: Option<f64>,
    /// The keypoints' noise, one standard deviation along one axis \[m\]: the error of a perfect model.
    pub noise_m: f64,
    /// Where the noise comes from, in words.
    pub noise_source: String,
    /// How many coefficients were fitted.
    pub coefficients: usize,
    /// How many of them the data determine, each by itself.
    pub determined: usize,
    /// How many runs they were fitted to.
    pub runs: usize,
    /// Lost images, of a run that was filmed.
    pub images: Option<Losses>,
    /// The verdict of the diagnosis, where one was made.
    pub diagnosis: Option<diagnose::Verdict>,
    /// Whether it finds the files wrong.
    pub is_misdescribed: bool,
}

/// The result in a sentence, with its colour.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Headline {
    /// How good the news is.
    pub tone: Tone,
    /// The sentence.
    pub line: String,
}

impl Findings {
    /// The findings of `fit`.
    pub fn of(fit: &Fit) -> Self {
        let source = match fit.noise_source {
            NoiseSource::Stated => "stated by the experiment",
            NoiseSource::Residuals => "estimated from the fit's residuals",
            NoiseSource::Images => "estimated from the images alone",
        };
        Self {
            error_m: fit.error_m,
            holdout_error_m: fit.holdout_error_m,
            noise_m: fit.noise_m,
            noise_source: source.into(),
            coefficients: fit.parameters.len(),
            determined: fit.parameters.iter().filter(|parameter| is_determined_alone(fit, parameter)).count(),
            runs: fit.runs.len(),
            ..Self::default()
        }
    }

    /// Adds the verdict of a diagnosis and its noise `floor_m` \[m\], which replaces the fit's: it is measured while the mechanism moves
    /// too.
    #[must_use]
    pub fn diagnosed(self, verdict: diagnose::Verdict, floor_m: f64) -> Self {
        let noise_source =
            "measured by the diagnosis, including errors of the images that follow the pose".into();
        Self { diagnosis: Some(verdict), noise_m: floor_m, noise_source, ..self }
    }

    /// Adds the lost images of a run that was filmed.
    #[must_use]
    pub fn filmed(self, losses: Losses) -> Self {
        Self { images: Some(losses), ..self }
    }

    /// The findings of `diagnosis` without a fit: the error is that of the simulation with the named causes.
    fn of_diagnosis(diagnosis: &Diagnosis) -> Self {
        let error_m = diagnosis.error_m(!diagnosis.causes.is_empty());
        Self { error_m, ..Self::default() }.diagnosed(diagnosis.verdict, diagnosis.floor_m())
    }

    /// Ratio of the simulation's error to the noise, by the worse of fitted and held-out runs.
    pub fn over_noise(&self) -> Option<f64> {
        let worst_m = self.error_m.into_iter().chain(self.holdout_error_m).reduce(f64::max)?;
        (self.noise_m > 0.0).then(|| worst_m / self.noise_m)
    }

    /// The headline of a fit.
    pub fn headline(&self) -> Headline {
        let clauses = [Some(self.error()), self.coefficients(), self.lost(), self.diagnosis()];
        Headline::joined(clauses.into_iter().flatten())
    }

    fn error(&self) -> (Tone, String) {
        let off = match (self.error_m, self.holdout_error_m) {
            (Some(fitted), Some(heldout)) => format!(
                "{} mm where it was fitted and {} mm on held-out runs",
                millimetres(fitted),
                millimetres(heldout)
            ),
            (Some(error), None) => format!("{} mm", millimetres(error)),
            (None, Some(error)) => format!("{} mm on held-out runs", millimetres(error)),
            (None, None) => return (Tone::Bad, "the fit left no error that could be scored".into()),
        };
        let Some(ratio) = self.over_noise() else {
            return (Tone::Caution, format!("the simulation is off by {off}; the noise is not known"));
        };
        let against_noise =
            format!("{} times the noise of {} mm", ratio_text(ratio), millimetres(self.noise_m));
        match ratio {
            ratio if ratio <= ERROR_AT_NOISE_RATIO => (
                Tone::Good,
                format!("the simulation follows the keypoints to their noise: off by {off}, {against_noise}"),
            ),
            ratio if ratio <= ERROR_TOO_LARGE_RATIO => {
                (Tone::Caution, format!("the simulation is off by {off}, {against_noise}"))
            }
            _ => (Tone::Bad, format!("the simulation is off by {off}, {against_noise}")),
        }
    }

    fn coefficients(&self) -> Option<(Tone, String)> {
        let (all, open) = (self.coefficients, self.coefficients - self.determined);
        let by = if self.runs == 1 { "this run" } else { "these runs" };
        let are = |count: usize| if count == 1 { "is" } else { "are" };
        match (all, open) {
            (0, _) => None,
            (1, 0) => Some((Tone::Good, format!("the coefficient is determined by {by}"))),
            (_, 0) => Some((Tone::Good, format!("all {all} coefficients are determined by {by}"))),
            (_, open) if open == all => {
                Some((Tone::Bad, format!("none of {} is determined by {by}", counted(all, "coefficient"))))
            }
            (_, open) => Some((
                Tone::Caution,
                format!("{open} of {} {} not determined by {by}", counted(all, "coefficient"), are(open)),
            )),
        }
    }

    /// Lost images. Images that cannot be read from the recording are always mentioned, however few.
    fn lost(&self) -> Option<(Tone, String)> {
        let losses = self.images?;
        let share = losses.share();
        let tone = if share > LOST_IMAGES_BAD_SHARE { Tone::Bad } else { Tone::Caution };
        losses
            .say()
            .filter(|_| share > LOST_IMAGES_CAUTION_SHARE || losses.unread > 0)
            .map(|said| (tone, said))
    }

    fn diagnosis(&self) -> Option<(Tone, String)> {
        use diagnose::Verdict;
        let verdict = self.diagnosis?;
        if self.is_misdescribed {
            return Some((Tone::Bad, "the diagnosis finds the files wrong".into()));
        }
        let says = match verdict {
            Verdict::NothingDetectable => "nothing wrong",
            Verdict::Cause => "the cause",
            Verdict::Causes => "the causes",
            Verdict::Suspected => "a cause that no other run has checked",
            Verdict::Ambiguous => "several causes that explain the runs equally well",
            Verdict::Unexplained => "something wrong that no known cause explains",
        };
        Some((diagnosis_tone(verdict), format!("the diagnosis finds {says}")))
    }
}

impl Headline {
    fn joined(clauses: impl Iterator<Item = (Tone, String)>) -> Self {
        let (tones, texts): (Vec<Tone>, Vec<String>) = clauses.unzip();
        let mut line = texts.join("; ") + ".";
        if let Some(first) = line.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        Self { tone: tones.into_iter().max().unwrap_or(Tone::Caution), line }
    }
}

/// How good the news of a diagnosis is.
pub(super) fn diagnosis_tone(verdict: diagnose::Verdict) -> Tone {
    use diagnose::Verdict;
    match verdict {
        Verdict::NothingDetectable | Verdict::Cause | Verdict::Causes => Tone::Good,
        Verdict::Suspected | Verdict::Ambiguous => Tone::Caution,
        Verdict::Unexplained => Tone::Bad,
    }
}

/// A ratio for reading: one decimal below 10, none above.
pub(super) fn ratio_text(ratio: f64) -> String {
    if ratio < 9.95 { format!("{ratio:.1}") } else { format!("{ratio:.0}") }
}

/// Whether the data determine a coefficient by itself, not only a combination with others.
pub fn is_determined_alone(fit: &Fit, parameter: &FittedParameter) -> bool {
    parameter.determined && !is_combined(fit, &parameter.name)
}

/// Whether only a combination of this coefficient with others is determined.
pub(super) fn is_combined(fit: &Fit, name: &str) -> bool {
    fit.unidentifiable.iter().any(|group| group.len() > 1 && group.iter().any(|member| member == name))
}

/// Whether all runs agree on a coefficient, as far as that was tested.
pub(super) fn is_constant(parameter: &FittedParameter) -> bool {
    parameter.constancy.is_none_or(|test| test.p >= CONSTANCY_P_VALUE)
}

/// The headline, and sentences that qualify it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Verdict {
    pub(super) headline: Headline,
    pub(super) details: Vec<String>,
}

/// The findings of a report's headline; none where nothing was fitted or diagnosed.
pub(super) fn findings(data: &ReportData) -> Option<Findings> {
    let diagnosis = data.diagnosis.as_ref().map(|figures| &figures.diagnosis);
    let findings = match (&data.fit, diagnosis) {
        (Some(fit), None) => Findings::of(fit),
        (Some(fit), Some(diagnosis)) => Findings::of(fit).diagnosed(diagnosis.verdict, diagnosis.floor_m()),
        (None, Some(diagnosis)) => Findings::of_diagnosis(diagnosis),
        (None, None) => return None,
    };
    let is_misdescribed = diagnosis.is_some_and(|diagnosis| !diagnosis.suspects.is_empty());
    Some(filmed(Findings { is_misdescribed, ..findings }, data))
}

fn filmed(findings: Findings, data: &ReportData) -> Findings {
    match &data.images {
        Some(images) => findings.filmed(images.losses),
        None => findings,
    }
}

/// The verdict of the data; its line mentions lost images.
pub(super) fn verdict(data: &ReportData) -> Verdict {
    let plain = |tone, line: String| Verdict { headline: Headline { tone, line }, details: Vec::new() };
    match (&data.end, &data.fit, &data.diagnosis, findings(data)) {
        (Some(RunEnd::Abort(reason)), ..) => plain(Tone::Bad, format!("Aborted: {reason}")),
        (Some(RunEnd::Fail(reason)), ..) => plain(Tone::Bad, format!("Failed: {reason}")),
        (_, Some(fit), _, Some(findings)) => {
            Verdict { headline: findings.headline(), details: details(fit, &findings, data) }
        }
        (_, None, Some(figures), Some(findings)) => {
            let diagnosis = &figures.diagnosis;
            let tone = findings.error().0.max(diagnosis_tone(diagnosis.verdict));
            let mut details = vec![definitions(&findings, 0.0)];
            details.extend(diagnosis_text::error(diagnosis));
            details.extend(diagnosis_text::details(diagnosis));
            Verdict { headline: Headline { tone, line: diagnosis.sentence.clone() }, details }
        }
        _ => {
            let clauses = [Some((Tone::Caution, measured(data))), filmed(Findings::default(), data).lost()];
            Verdict { headline: Headline::joined(clauses.into_iter().flatten()), details: Vec::new() }
        }
    }
}

fn measured(data: &ReportData) -> String {
    let keypoints = data.runs.iter().map(|run| run.measured.keypoints.len()).max().unwrap_or(0);
    match &data.images {
        Some(images) => {
            format!("filmed and measured: {} of {} images gave keypoints", images.used, images.received)
        }
        None if keypoints > 0 => format!("measured {}; no model was fitted", counted(keypoints, "keypoint")),
        None => "nothing was measured".into(),
    }
}

/// The definitions of error and noise for the reader.
fn definitions(findings: &Findings, length_m: f64) -> String {
    let worst_m = findings.error_m.into_iter().chain(findings.holdout_error_m).fold(0.0, f64::max);
    let share = match length_m > 0.0 && worst_m > 0.0 {
        true => format!(", {} % of the {:.0} mm length", percent(worst_m, length_m), length_m * 1e3),
        false => String::new(),
    };
    format!(
        "Error: root mean square along one axis, over all keypoints but P0{share}. Noise: one standard deviation along one axis, {}.",
        findings.noise_source
    )
}

fn details(fit: &Fit, findings: &Findings, data: &ReportData) -> Vec<String> {
    let mut details = vec![definitions(findings, fit.characteristic_length_m)];
    if let Some(figures) = &data.diagnosis {
        details.push(format!("Diagnosis: {}", figures.diagnosis.sentence));
    }
    if let (Some(fitted), Some(heldout)) = (findings.error_m, findings.holdout_error_m)
        && heldout > 2.0 * fitted
    {
        let ratio = heldout / fitted;
        details.push(format!("Held-out runs are predicted {ratio:.1} times worse than the fitted ones."));
    }
    let lost = fit.runs.iter().flat_map(|run| run.lost.iter().map(|lost| lost.sentence(&run.id)));
    details.extend(lost.map(|sentence| format!("{sentence}.")));
    let set_aside = fit.runs.iter().filter_map(|run| Spike::sentence(&run.id, &run.set_aside));
    details.extend(set_aside.map(|sentence| format!("{sentence}.")));
    details.extend(on_coefficients(fit));
    for (run, touch) in fit.runs.iter().filter_map(|run| Some((run, run.touch.as_ref()?))) {
        details.push(format!("In the simulation of {}, {touch}.", run.id));
    }
    let elsewhere = fit.starts.iter().filter(|start| !start.agrees).count();
    if elsewhere > 0 {
        details.push(format!(
            "{elsewhere} of {} of the search ended in other optima; the best one is used.",
            counted(fit.starts.len(), "start")
        ));
    }
    details
}

/// Sentences on coefficients at a bound or that differ from run to run.
fn on_coefficients(fit: &Fit) -> Vec<String> {
    let mut details = Vec::new();
    let bound = fit.parameters.iter().filter(|p| p.at_bound).count();
    if bound > 0 {
        let are = if bound == 1 { "coefficient is" } else { "coefficients are" };
        details.push(format!("{bound} {are} at a bound."));
    }
    let drifting: Vec<&str> =
        fit.parameters.iter().filter(|p| !is_constant(p)).map(|p| p.name.as_str()).collect();
    if !drifting.is_empty() {
        details.push(format!(
            "The runs do not agree on {}: its fitted value covers for an effect that differs from run to run.",
            drifting.join(", ")
        ));
    }
    details
}
