//! Filmed above, simulated below, at the same instants.

use maud::{Markup, html};

use super::data::RunFigures;
use super::format::millimetres;
use super::picture::Picture;

/// With more keypoints than this, only mean and worst error are listed. Chosen.
const LISTED_KEYPOINTS_MAX: usize = 8;

/// The film strip of a run; nothing where there is none.
pub(super) fn strip(run: &RunFigures) -> Markup {
    if run.strip.is_empty() {
        return html! {};
    }
    let pictures = |simulated: bool| {
        html! {
            tr {
                th { (if simulated { "simulated" } else { "filmed" }) }
                @for one in &run.strip {
                    @let (image, what) = if simulated { (&one.simulated, "simulated") } else { (&one.filmed, "filmed") };
                    td { @if let Some(picture) = Picture::of(image, None) {
                        img src=(picture.source()) width=(image.width()) height=(image.height())
                            alt=(format!("{what} at {:.2} s", one.time_s));
                    } }
                }
            }
        }
    };
    html! {
        h3 { "Filmed and simulated, at the same instants" }
        div.filmstrip { table {
            thead { tr { th { "time" } @for one in &run.strip { th.number { (format!("{:.2} s", one.time_s)) } } } }
            tbody {
                (pictures(false))
                (pictures(true))
                @for (name, cells) in errors(run) {
                    tr { th { (name) } @for cell in cells { td.number { (cell) } } }
                }
            }
        } }
    }
}

/// Rows of errors: each keypoint's, or mean and worst of many.
fn errors(run: &RunFigures) -> Vec<(String, Vec<String>)> {
    let names = &run.measured.keypoints;
    if names.len() <= LISTED_KEYPOINTS_MAX {
        let cell = |errors: &[(String, f64)], name: &String| {
            let error = errors.iter().find(|(other, _)| other == name);
            error.map_or("–".into(), |(_, error)| millimetres(*error))
        };
        let row = |name: &String| {
            (format!("{name} error [mm]"), run.strip.iter().map(|one| cell(&one.errors_m, name)).collect())
        };
        return names.iter().map(row).collect();
    }
    let mean = |errors: &[(String, f64)]| match errors.len() {
        0 => "–".into(),
        count => millimetres(errors.iter().map(|(_, error)| error).sum::<f64>() / count as f64),
    };
    let worst = |errors: &[(String, f64)]| {
        let worst = errors.iter().max_by(|(_, a), (_, b)| a.total_cmp(b));
        worst.map_or("–".into(), |(name, error)| format!("{} ({name})", millimetres(*error)))
    };
    vec![
        ("mean error [mm]".into(), run.strip.iter().map(|one| mean(&one.errors_m)).collect()),
        ("worst error [mm]".into(), run.strip.iter().map(|one| worst(&one.errors_m)).collect()),
    ]
}
