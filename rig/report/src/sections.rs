//! The page, section by section. Each is empty when its part of the data is.

use ident::experiment::Use;
use ident::fit::RunErrors;
use ident::loss::REFERENCE_END;
use maud::{Markup, html};

use super::chart::KEYPOINTS;
use super::data::{ReportData, RunEnd, RunFigures};
use super::format::{counted, duration, millimetres, percent, significant};
use super::verdict::{findings, ratio_text, verdict};
use super::{figures, picture, strip};

/// Title, verdict, key figures, warnings.
pub(super) fn heading(data: &ReportData) -> Markup {
    let verdict = verdict(data);
    html! {
        header {
            p.kicker { "rig report" @if !data.date.is_empty() { " · " (data.date) } }
            h1 { (data.id) }
            @if !data.description.is_empty() { p.lead { (data.description) } }
        }
        div class={ "verdict " (verdict.headline.tone.class()) } {
            p.line { (verdict.headline.line) }
            @if !verdict.details.is_empty() { ul { @for detail in &verdict.details { li { (detail) } } } }
        }
        (tiles(data))
        @if !data.warnings.is_empty() {
            div.note { h3 { "Warnings" } ul { @for warning in &data.warnings { li { (warning) } } } }
        }
    }
}

fn tiles(data: &ReportData) -> Markup {
    let mut tiles: Vec<(String, String)> = Vec::new();
    if let Some(findings) = findings(data) {
        for (error, name) in [(findings.error_m, "error"), (findings.holdout_error_m, "error, held out")] {
            tiles.extend(error.map(|error| (format!("{} mm", millimetres(error)), name.into())));
        }
        if findings.noise_m > 0.0 {
            tiles.push((format!("{} mm", millimetres(findings.noise_m)), "noise".into()));
        }
        tiles.extend(findings.over_noise().map(|ratio| (ratio_text(ratio), "error over noise".into())));
        if findings.coefficients > 0 {
            let determined = format!("{} of {}", findings.determined, findings.coefficients);
            tiles.push((determined, "coefficients determined".into()));
        }
    }
    if let Some(fit) = &data.fit {
        tiles.push((fit.evaluations.to_string(), format!("evaluations, {}", fit.method)));
    }
    if let Some(images) = &data.images {
        tiles.push((format!("{} of {}", images.used, images.received), "images used".into()));
    }
    if let Some(end) = &data.end {
        let word = match end {
            RunEnd::Success => "success",
            RunEnd::Abort(_) => "abort",
            RunEnd::Fail(_) => "fail",
        };
        tiles.push((word.into(), "how the run ended".into()));
    }
    html! {
        @if !tiles.is_empty() {
            dl.tiles { @for (value, name) in tiles { div { dt { (name) } dd { (value) } } } }
        }
    }
}

/// The paper's Table I: mean keypoint errors of each run.
pub(super) fn table_of_errors(data: &ReportData) -> Markup {
    let Some(fit) = data.fit.as_ref().filter(|fit| !fit.runs.is_empty()) else { return html! {} };
    let mut names: Vec<&str> = Vec::new();
    for keypoint in fit.runs.iter().flat_map(|run| &run.keypoints) {
        if !names.contains(&keypoint.name.as_str()) {
            names.push(&keypoint.name);
        }
    }
    let length = fit.characteristic_length_m;
    let mean = |run: &RunErrors| {
        let errors: Vec<f64> =
            run.keypoints.iter().filter(|k| k.name != REFERENCE_END).map(|k| k.mean_error_m).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let cell = |error: f64| {
        html! { (millimetres(error)) span.share { (percent(error, length)) " %" } }
    };
    html! {
        section #errors {
            h2 { "Keypoint errors" }
            p.lead {
                "Mean distance between measured and simulated keypoints over the run in mm, and in percent of the "
                (format!("{:.0}", length * 1e3)) " mm length (the paper's Table I). The mean leaves out P0, the reference end."
            }
            table.errors {
                thead { tr {
                    th { "run" } th { "use" } @for name in &names { th.number { (name) } } th.number { "mean" }
                } }
                tbody {
                    @for run in &fit.runs {
                        tr {
                            td { (run.id) }
                            td { @if run.usage == Use::Holdout { span.flag.holdout { "held out" } } @else { "fitted" } }
                            @for name in &names {
                                td.number {
                                    @match run.keypoints.iter().find(|k| k.name == *name) {
                                        Some(keypoint) => (cell(keypoint.mean_error_m)),
                                        None => "–",
                                    }
                                }
                            }
                            td.number { strong { (cell(mean(run))) } }
                        }
                    }
                }
            }
        }
    }
}

/// One run's figures.
pub(super) fn run(data: &ReportData, run: &RunFigures) -> Markup {
    if run.measured.time_s.is_empty() {
        return html! {};
    }
    let noise_m = findings(data).map_or(0.0, |findings| findings.noise_m);
    let simulated = !run.simulated.time_s.is_empty();
    html! {
        section.run {
            h2 { "Run " (run.id) @if run.usage == Use::Holdout { " " span.flag.holdout { "held out" } } }
            p.legend {
                span.key.measured {} "measured"
                @if simulated { span.key.simulated {} "simulated" }
                @if run.start_s.is_some() { span.key.mark {} "starts to move" }
            }
            div.triple { (figures::first_pose(run)) (figures::superimposed(run)) }
            @if run.measured_pose.is_some() || run.simulated_pose.is_some() {
                h3 { "First pose, filmed and rendered" }
                div.pictures {
                    @if let Some(pose) = &run.measured_pose { (picture::overlay(pose)) }
                    @if let Some(pose) = &run.simulated_pose { (picture::plain(pose, "simulated")) }
                }
            }
            (strip::strip(run))
            h3 { "Keypoints over time" }
            (figures::over_time(run))
            @if simulated {
                h3 { "Residuals" }
                p.legend {
                    @for (k, name) in run.measured.keypoints.iter().enumerate() {
                        span class={ "key k" (k % KEYPOINTS.len()) } {} (name)
                    }
                    @if noise_m > 0.0 { span.key.band {} "±2 σ of the keypoint noise" }
                }
                (figures::residuals(run, noise_m))
            }
        }
    }
}

/// Selected images with mask, centreline and keypoints.
pub(super) fn pictures(data: &ReportData) -> Markup {
    html! {
        @if !data.overlays.is_empty() {
            section #images {
                h2 { "Images with keypoints" }
                p.lead { "Mask tinted blue, centreline in yellow, keypoints as dots." }
                div.pictures { @for overlay in &data.overlays { (picture::overlay(overlay)) } }
            }
        }
    }
}

/// Servo angles over time.
pub(super) fn servo(data: &ReportData) -> Markup {
    let Some(trace) = data.servo.as_ref().filter(|t| !t.commanded.time_s.is_empty()) else { return html! {} };
    html! {
        section #servo {
            h2 { "Servo" }
            p.legend {
                span.key.k1 {} "commanded"
                @if trace.measured.is_some() { span.key.k0 {} "measured by the servo" }
            }
            (figures::servo(trace))
        }
    }
}

/// Images and clocks.
pub(super) fn quality(data: &ReportData) -> Markup {
    if data.images.is_none() && data.clocks.is_empty() {
        return html! {};
    }
    html! {
        section #quality {
            h2 { "Data quality" }
            table.facts {
                @if let Some(images) = &data.images {
                    tr { th { "images received" } td { (images.received) } }
                    tr { th { "images used" } td { (images.used) } }
                    @for (reason, count) in &images.rejected {
                        tr { th { "rejected" } td { (count) ": " (reason) } }
                    }
                    tr { th { "lost before the host" } td { (counted(images.lost, "image")) } }
                    tr { th { "dropped on the host" } td { (counted(images.dropped, "image")) } }
                    tr { th { "lost from the recording" } td { (counted(images.unread, "image")) } }
                    @if let Some(fps) = images.fps { tr { th { "rate" } td { (format!("{fps:.2} images/s")) } } }
                    @if let Some(gap) = images.longest_gap_s {
                        tr { th { "longest gap between images" } td { (duration(gap)) } }
                    }
                }
                @for clock in &data.clocks {
                    tr {
                        th { "clock of the " (clock.name) }
                        td {
                            "known to " (duration(clock.sigma_s)) " (1 σ, " (counted(clock.samples, "sample")) ")"
                            @if let Some(ppm) = clock.drift_ppm { (format!(", rate off by {ppm:+.1} ppm")) }
                        }
                    }
                }
            }
        }
    }
}

/// Wall times of the stages.
pub(super) fn timings(data: &ReportData) -> Markup {
    let longest = data.timing.stages.iter().map(|s| s.wall_s).fold(0.0, f64::max);
    html! {
        @if !data.timing.stages.is_empty() {
            section #timings {
                h2 { "Timings" }
                @if data.timing.workers > 0 {
                    p.lead { "Wall times; the fit used " (counted(data.timing.workers, "thread")) "." }
                }
                table.facts {
                    @for stage in &data.timing.stages {
                        @let share = if longest > 0.0 { stage.wall_s / longest * 100.0 } else { 0.0 };
                        tr {
                            th { (stage.name) }
                            td.number { (duration(stage.wall_s)) }
                            td.wide {
                                svg.strip viewBox="0 0 100 12" preserveAspectRatio="none" {
                                    rect.sigma x="0" y="2" width=(format!("{share:.2}")) height="8" {}
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// What is needed to reproduce the result.
pub(super) fn provenance(data: &ReportData) -> Markup {
    html! {
        @if data.fit.is_some() || !data.provenance.is_empty() || data.config_toml.is_some() {
            section #provenance {
                h2 { "Provenance" }
                table.facts {
                    @for (name, value) in &data.provenance { tr { th { (name) } td { (value) } } }
                    @if let Some(fit) = &data.fit {
                        tr { th { "fit" } td {
                            (fit.method) ", seed " (fit.seed) ", " (fit.evaluations) " evaluations, " (fit.rollouts)
                            " rollouts; stopped: " (fit.stop_reason)
                        } }
                        tr { th { "loss" } td { (significant(fit.loss_m2 * 1e6)) " mm² (sum over keypoints, mean over images)" } }
                    }
                }
                @if let Some(config) = &data.config_toml {
                    details { summary { "config as used" } pre { (config) } }
                }
            }
        }
    }
}
