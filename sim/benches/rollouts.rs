//! Whole runs of the reference models, per instruction set: `cargo bench -p sim [-- FILTER]`.
//!
//! Throughput counts candidates, so that `elem/s` is runs a second on one thread. `examples/throughput.rs` has the same runs
//! beside their errors.
#![allow(missing_docs, reason = "criterion's macros make functions")]

#[path = "../examples/cases/mod.rs"]
mod cases;

use cases::{Case, MODELS};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sim::batch;
use sim::sensitivities::{self, Direction};
use sim::{ContactWatch, Integrator, Isa, Model, RolloutOptions};

/// What a fit asks for \[m\].
const ACCURACY_M: f64 = 1e-5;

fn case(name: &str) -> Case {
    Case::named(name).ok().flatten().unwrap_or_else(|| panic!("the reference model {name}"))
}

/// Candidates side by side, in MuJoCo's Euler steps and in planned ones.
fn candidates(criterion: &mut Criterion) {
    for (name, ..) in MODELS {
        let case = case(name);
        let planned = case.plan(ACCURACY_M).map(|plan| plan.steps).unwrap_or_else(|error| panic!("{error}"));
        let ways = [
            ("euler-1ms", Case::mujoco(Integrator::Euler, 0.001)),
            ("planned-10um", RolloutOptions { steps: Some(planned), ..RolloutOptions::default() }),
        ];
        let mut group = criterion.benchmark_group(name);
        group.sample_size(10);
        for (way, options) in &ways {
            for isa in Isa::available() {
                let candidates = case.candidates(isa.candidates());
                group.throughput(Throughput::Elements(candidates.len() as u64));
                group.bench_function(BenchmarkId::new(*way, isa.name()), |bencher| {
                    bencher.iter(|| {
                        let times = [case.duration_s];
                        batch::positions(&case.model, &[], &candidates, &case.command, &times, options, isa)
                    });
                });
            }
        }
        group.finish();
    }
}

/// One candidate with its derivatives by every parameter of a geom's water.
fn derivatives(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sensitivities");
    group.sample_size(10);
    for name in ["chain_passive", "chain_active"] {
        let case = case(name);
        let names: Vec<String> = case.model.parameter_names();
        let wet: Vec<&String> = names.iter().filter(|name| name.starts_with('g')).collect();
        let parameters: Vec<_> = wet.iter().filter_map(|name| case.model.find_parameter(name).ok()).collect();
        let mut candidate = case.candidates(1).remove(0);
        candidate.values = parameters.iter().map(|&parameter| case.model.get(parameter)).collect();
        let directions: Vec<Direction> = (0..parameters.len())
            .map(|k| Direction {
                values: (0..parameters.len()).map(|i| f64::from(u8::from(i == k))).collect(),
                qpos: vec![0.0; case.model.nq()],
                qvel: vec![0.0; case.model.nv()],
                start_s: 0.0,
            })
            .collect();
        let planned = case.plan(ACCURACY_M).map(|plan| plan.steps).unwrap_or_else(|error| panic!("{error}"));
        let options = RolloutOptions { steps: Some(planned), ..RolloutOptions::default() };
        let times = case.samples();
        for isa in Isa::available() {
            group.throughput(Throughput::Elements(directions.len() as u64));
            group.bench_function(BenchmarkId::new(name, isa.name()), |bencher| {
                bencher.iter(|| {
                    sensitivities::sensitivities(
                        &case.model,
                        &parameters,
                        &candidate,
                        &directions,
                        &case.command,
                        &times,
                        &options,
                        isa,
                    )
                });
            });
        }
    }
    group.finish();
}

/// What comes once a run: the plan of its steps; one look for contact.
fn once(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("once");
    group.sample_size(10);
    for name in ["chain_passive", "chain_active", "arm8"] {
        let case = case(name);
        group
            .bench_function(BenchmarkId::new("plan", name), |bencher| bencher.iter(|| case.plan(ACCURACY_M)));
    }
    // every pair of the arm's segments that are not neighbours
    let (_, text, _) = MODELS[3];
    let model =
        Model::from_mjcf(&text.replace("contype=\"0\" conaffinity=\"0\"", "contype=\"1\" conaffinity=\"1\""));
    if let Some(mut watch) = model.as_ref().ok().and_then(ContactWatch::new) {
        let qpos = vec![0.3; 8];
        group.bench_function("look-for-contact/arm8", |bencher| bencher.iter(|| watch.closest(&qpos).1));
    }
    group.finish();
}

criterion_group!(benches, candidates, derivatives, once);
criterion_main!(benches);
