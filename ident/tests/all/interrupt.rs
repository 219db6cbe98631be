//! A fit or a diagnosis that nobody waits for any longer ends soon, whatever stage it is in.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use crate::common::{self, filmed_exactly, still};
use ident::diagnose::{DiagnoseError, Diagnosed, Observer, diagnose};
use ident::experiment::{Experiment, FitConfig, Method, Run, RunKind};
use ident::fit::{self, FitError, Flow, INTERRUPTED, Progress, fit};
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

/// Copies of one run: making them ready takes a while.
const MANY_RUNS: usize = 60;

/// Raises the flag a while after the fit has begun, or after it has last said how far it is.
struct Timer {
    from_last_word: bool,
    words: usize,
    stop: Arc<AtomicBool>,
    raised: Arc<OnceLock<Instant>>,
    /// What is raised later, and how many words there were when that was decided.
    said: Arc<AtomicUsize>,
}

impl Timer {
    fn new(from_last_word: bool) -> Self {
        let timer = Self {
            from_last_word,
            words: 0,
            stop: Arc::default(),
            raised: Arc::default(),
            said: Arc::default(),
        };
        if !from_last_word {
            timer.raise_soon();
        }
        timer
    }

    fn raise_soon(&self) {
        let (stop, raised, said, words) =
            (Arc::clone(&self.stop), Arc::clone(&self.raised), Arc::clone(&self.said), self.words);
        std::thread::spawn(move || {
            std::thread::sleep(PATIENCE);
            if said.load(Ordering::Relaxed) == words && raised.set(Instant::now()).is_ok() {
                stop.store(true, Ordering::Relaxed);
            }
        });
    }
}

impl fit::Observer for Timer {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        self.words += 1;
        self.said.store(self.words, Ordering::Relaxed);
        // a descent that has come to its end says so last
        if self.from_last_word && progress.is_answer {
            self.raise_soon();
        }
        Flow::Continue
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }
}

#[test]
fn a_fit_interrupted_while_it_prepares_or_finishes_ends_soon() {
    let mut experiment = experiment();
    experiment.fit.method = Method::LeastSquares;
    let mut many = experiment.clone();
    many.runs = (0..MANY_RUNS)
        .map(|k| Run { id: format!("copy-{k}"), ..experiment.runs[k % experiment.runs.len()].clone() })
        .collect();
    let mut preparing = Timer::new(false);
    let ended = fit(&many, &mut preparing);
    let late = preparing.raised.get().unwrap().elapsed();
    println!("preparing: {:.2} s", late.as_secs_f64());
    assert!(matches!(ended, Err(FitError::Interrupted)), "{:?}", ended.map(|fitted| fitted.fit.stop_reason));
    assert_eq!(preparing.words, 0);
    assert!(late < SOON, "{late:?}");

    experiment.fit.profile = true;
    let mut finishing = Timer::new(true);
    let ended = fit(&experiment, &mut finishing);
    let late = finishing.raised.get().unwrap().elapsed();
    println!("finishing: {:.2} s", late.as_secs_f64());
    // where an iteration was to come, what was found until then follows
    let is_interrupted = match &ended {
        Ok(fitted) => fitted.fit.stop_reason == INTERRUPTED,
        Err(error) => matches!(error, FitError::Interrupted),
    };
    assert!(is_interrupted, "{:?}", ended.map(|fitted| fitted.fit.stop_reason));
    assert!(late < SOON, "{late:?}");
}

/// Raises the flag from another thread in the midst of an iteration.
struct Midway(Arc<AtomicBool>);

impl fit::Observer for Midway {
    fn progress(&mut self, _: &Progress<'_>) -> Flow {
        let stop = Arc::clone(&self.0);
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(2));
            stop.store(true, Ordering::Relaxed);
        });
        Flow::Continue
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }
}

#[test]
fn an_iteration_cut_short_leaves_the_point_before_it() {
    let experiment = experiment();
    let one_iteration = {
        let mut once = experiment.clone();
        once.fit.max_evaluations = 12;
        fit(&once, &mut ()).unwrap().fit
    };
    match fit(&experiment, &mut Midway(Arc::default())) {
        Ok(fitted) => {
            assert_eq!(fitted.fit.stop_reason, INTERRUPTED);
            assert!(fitted.fit.loss_m2 <= one_iteration.loss_m2 * 100.0, "{:e}", fitted.fit.loss_m2);
        }
        // a machine with other things to do may take longer than anybody waits
        Err(FitError::Interrupted) => {}
        Err(error) => panic!("{error}"),
    }
}
