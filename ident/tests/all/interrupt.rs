//! A diagnosis that nobody waits for any longer ends soon, whatever stage it is in.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use crate::common::{self, filmed_exactly, still};
use ident::diagnose::{DiagnoseError, Diagnosed, Observer, diagnose};
use ident::experiment::{Experiment, FitConfig, Run, RunKind};
use sim::{Command, Model};

/// Links of the arm: as many as make every stage of its diagnosis take a while.
const LINKS: usize = 4;

/// An arm of equal links, each with a hinge.
fn arm() -> Model {
    let link = |k: usize| {
        format!(
            "<body name=\"b{k}\" pos=\"0 0 {}\" gravcomp=\"0.8\"><joint name=\"q{k}\" axis=\"0 -1 0\" damping=\"5e-6\"/>\
             <geom name=\"g{k}\" type=\"box\" size=\"0.005 0.0025 0.0125\" pos=\"0 0 -0.0125\" density=\"1200\"/>\
             <site name=\"P{k}\" pos=\"0 0 -0.025\"/>",
            if k == 1 { 0.0 } else { -0.025 }
        )
    };
    let bodies: String = (1..=LINKS).map(link).collect();
    let ends = "</body>".repeat(LINKS);
    Model::from_mjcf(&format!(
        "<mujoco><option density=\"1000\" viscosity=\"0.001\" timestep=\"0.001\" integrator=\"implicitfast\"/>\
         <default><geom fluidshape=\"ellipsoid\"/></default><worldbody>{bodies}{ends}</worldbody></mujoco>"
    ))
    .unwrap()
}

fn experiment() -> Experiment {
    let model = arm();
    let mut truth = model.clone();
    truth.add_cause("added_mass").unwrap();
    truth.set_parameter("added_mass/scale", 1.0).unwrap();
    let run = |(number, angle): (u64, f64)| {
        let mut state = still([0.0; 3]);
        state.qpos = vec![0.0; LINKS];
        state.qpos[0] = angle;
        state.qvel = vec![0.0; LINKS];
        let mut trajectory = filmed_exactly(&truth, &state, &Command::default(), 0.3, 2.0, true);
        common::add_noise(&mut trajectory, 4e-4, 0.4, number);
        Run { release_s: Some(0.3), ..Run::new(format!("drop-{number}"), RunKind::Drop, trajectory) }
    };
    let runs = [(1, 1.5), (2, -0.8), (3, 0.6)].map(run).to_vec();
    let fit = FitConfig { parameters: vec!["fluidcoef".into(), "damping".into()], ..FitConfig::default() };
    Experiment::new(model, fit, runs)
}

/// Raises the flag when a stage has gone on for a while.
struct Impatient {
    stage: &'static str,
    stop: Arc<AtomicBool>,
    raised: Arc<OnceLock<Instant>>,
}

/// Of stages that each take longer.
const PATIENCE: Duration = Duration::from_millis(20);
/// One simulation at most is under way on each thread, some 0.1 s; the rest is for a machine that has other things to do.
const SOON: Duration = Duration::from_secs(3);

impl Observer for Impatient {
    fn stage(&mut self, stage: &str) -> bool {
        if stage.starts_with(self.stage) && self.raised.get().is_none() {
            let (stop, raised) = (Arc::clone(&self.stop), Arc::clone(&self.raised));
            std::thread::spawn(move || {
                std::thread::sleep(PATIENCE);
                let _ = raised.set(Instant::now());
                stop.store(true, Ordering::Relaxed);
            });
        }
        true
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }
}

#[test]
fn interrupted_in_the_midst_of_a_stage_it_ends_soon() {
    let experiment = experiment();
    for stage in ["fitting the baseline", "trying", "checking"] {
        let mut observer = Impatient { stage, stop: Arc::default(), raised: Arc::default() };
        match (stage, diagnose(&experiment, &mut observer)) {
            ("fitting the baseline", Err(DiagnoseError::Interrupted)) => {}
            // from there on there is something to say, whether or not there was time for all of it
            (_, Ok(Diagnosed { diagnosis, .. })) => {
                assert!(stage == "checking" || !diagnosis.complete, "{stage}");
            }
            (_, Err(error)) => panic!("{stage}: {error}"),
        }
        let late = observer.raised.get().unwrap().elapsed();
        println!("{stage}: {:.2} s", late.as_secs_f64());
        assert!(late < SOON, "{stage}: {late:?}");
    }
}
