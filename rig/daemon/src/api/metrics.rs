//! What a monitor wants to know, in Prometheus' text format (<https://prometheus.io/docs/instrumenting/exposition_formats/>).

use std::fmt::Write as _;
use std::sync::Arc;

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use super::{Api, Problem};
use crate::state::Doing;
use store::job::Lane;

/// A metric: name, kind, help.
const METRICS: [(&str, &str, &str); 8] = [
    ("rig_moving", "gauge", "Whether the servos move, as measured."),
    ("rig_computing", "gauge", "Whether a job computes."),
    ("rig_jobs_waiting", "gauge", "Jobs that wait for their turn."),
    ("rig_jobs_total", "counter", "Jobs that are over, by how they ended."),
    ("rig_runs", "gauge", "Runs in the index, by how they ended."),
    ("rig_disk_free_bytes", "gauge", "Free space where the runs are."),
    ("rig_doing", "gauge", "What the rig does: 1 for that, 0 for all else."),
    ("rig_held", "gauge", "Whether a stop holds the rig."),
];

/// Metrics of all rigs.
#[utoipa::path(get, path = "/metrics", responses((status = 200, description = "Metrics.", content_type = "text/plain", body = String)))]
pub(super) async fn metrics(State(api): State<Arc<Api>>) -> Result<Response, Problem> {
    let mut samples: [String; METRICS.len()] = Default::default();
    for rig in &api.rigs {
        let counted = rig
            .ask(|store| {
                let waiting = store.waiting(Lane::Motion)? + store.waiting(Lane::Analysis)?;
                Ok((waiting, store.jobs_by_state()?, store.runs_by_status()?))
            })
            .await?;
        let (waiting, jobs, runs) = counted;
        let (name, doing, computing, held) = {
            let state = rig.state.borrow();
            let computing = state.analysis.is_some() || state.doing == Doing::Computing;
            (escaped(&state.name), state.doing, computing, state.hold.is_some())
        };
        let mut sample = |place: usize, label: &str, value: f64| {
            let _ = writeln!(samples[place], "{}{{rig=\"{name}\"{label}}} {value}", METRICS[place].0);
        };
        sample(0, "", f64::from(u8::from(doing == Doing::Moving)));
        sample(1, "", f64::from(u8::from(computing)));
        sample(2, "", f64::from(waiting));
        jobs.iter().for_each(|(state, count)| {
            sample(3, &format!(",state=\"{}\"", escaped(state)), f64::from(*count))
        });
        runs.iter().for_each(|(status, count)| {
            sample(4, &format!(",status=\"{}\"", escaped(status)), f64::from(*count))
        });
        for (one, word) in Doing::ALL {
            sample(6, &format!(",doing=\"{word}\""), f64::from(u8::from(doing == one)));
        }
        sample(7, "", f64::from(u8::from(held)));
        if let Ok(disk) = rustix::fs::statvfs(&rig.runs_dir) {
            sample(5, "", disk.f_bavail.saturating_mul(disk.f_frsize) as f64);
        }
    }
    let mut text = String::new();
    for ((name, kind, help), samples) in METRICS.iter().zip(&samples) {
        let _ = write!(text, "# HELP {name} {help}\n# TYPE {name} {kind}\n{samples}");
    }
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response())
}

/// A label's value.
fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
