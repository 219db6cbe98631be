//! Runs `rig diagnose` on a case and keeps what it says.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::cases::{Case, Kind};
use super::hide::Truth;
use super::limit::Benches;
use super::write::{Film, write};
use crate::{json, printed, rig};

/// A named cause, as the diagnosis states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// The one element that it sits in, where it says so.
    #[serde(default)]
    pub element: Option<String>,
    /// Causes that no video tells from it.
    pub aliases: Vec<String>,
    /// Its parameters: name, value, 95 % interval.
    pub parameters: Vec<(String, f64, [f64; 2])>,
}

/// What became of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The case.
    pub id: String,
    /// What it hid: "nothing", "one", "pair" or "outside".
    pub kind: String,
    /// Multiple of the limit asked for; 0 where it has none.
    pub asked: f64,
    /// What should be found.
    pub truth: Vec<Truth>,
    /// The verdict; "failed" where the program gave none.
    pub verdict: String,
    /// The causes it names.
    pub causes: Vec<Named>,
    /// Sets of causes it cannot tell from them.
    pub alternatives: Vec<Vec<String>>,
    /// The best description where it names none.
    pub partial: Vec<String>,
    /// What it says is at work all the same.
    #[serde(default)]
    pub established: Vec<String>,
    /// Held-out rms before and after, and the noise floor \[m\].
    pub heldout_m: Option<[f64; 3]>,
    /// How long the program took \[s\].
    pub wall_s: f64,
    /// On how many threads.
    pub threads: usize,
    /// What went wrong, for a failed one.
    pub error: String,
}

/// Makes `case`, filmed as `film` says, in `folder`, has it diagnosed there and yields what came of it; `None` where these runs cannot show what should be
/// hidden.
///
/// # Panics
/// When files cannot be written or the program cannot be started.
pub fn diagnose<const N: usize>(
    case: &Case,
    benches: &mut Benches<N>,
    film: Film,
    folder: &Path,
) -> Option<Outcome> {
    let made = case.make(benches)?;
    std::fs::create_dir_all(folder).expect("a folder for the case");
    let experiment = write(case, &made, film, folder).expect("the case's files");
    Some(judge(case, made.truth, &experiment, &folder.join("diagnosis")))
}

/// Has `experiment` diagnosed into `out`, with its share of the cores: the thread pool this runs in says how many cases are under way.
///
/// # Panics
/// When the program cannot be started.
pub fn judge(case: &Case, truth: Vec<Truth>, experiment: &Path, out: &Path) -> Outcome {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = (cores / rayon::current_num_threads()).max(1);
    let started = Instant::now();
    let mut program = rig(["diagnose".as_ref(), experiment.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    let output =
        program.arg("--json").env("RAYON_NUM_THREADS", threads.to_string()).output().expect("rig starts");
    let wall_s = started.elapsed().as_secs_f64();
    let (kind, asked) = match case.kind {
        Kind::Nothing => ("nothing", 0.0),
        Kind::One(_, size) => ("one", size),
        Kind::Pair(..) => ("pair", 0.0),
        Kind::Outside(_, size) => ("outside", size),
    };
    let mut outcome = Outcome {
        id: case.id.clone(),
        kind: kind.into(),
        asked,
        truth,
        verdict: "failed".into(),
        causes: Vec::new(),
        alternatives: Vec::new(),
        partial: Vec::new(),
        established: Vec::new(),
        heldout_m: None,
        wall_s,
        threads,
        error: String::new(),
    };
    let file = out.join("diagnosis.json");
    if output.status.success() && file.exists() {
        outcome.read(&json(&file));
    } else {
        outcome.error = printed(&output);
    }
    outcome
}

fn texts(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(|text| text.as_str().map(str::to_owned)).collect()
}

impl Outcome {
    /// Takes in a `diagnosis.json`.
    fn read(&mut self, diagnosis: &Value) {
        self.verdict = diagnosis["verdict"].as_str().unwrap_or("failed").into();
        self.causes = diagnosis["causes"].as_array().into_iter().flatten().map(named).collect();
        let alternatives = diagnosis["alternatives"].as_array().into_iter().flatten();
        self.alternatives = alternatives.map(|set| texts(&set["names"])).collect();
        let names = |key: &str| -> Vec<String> {
            let list = diagnosis[key].as_array().into_iter().flatten();
            list.filter_map(|part| part.as_str().or(part["name"].as_str()).map(str::to_owned)).collect()
        };
        (self.partial, self.established) = (names("partial"), names("established"));
        let heldout = &diagnosis["heldout"];
        let numbers = ["rms_before_m", "rms_after_m", "noise_floor_m"].map(|key| heldout[key].as_f64());
        if let [Some(before), Some(after), Some(floor)] = numbers {
            self.heldout_m = Some([before, after, floor]);
        }
    }
}

fn named(cause: &Value) -> Named {
    let parameters = cause["parameters"].as_array().into_iter().flatten();
    Named {
        name: cause["name"].as_str().unwrap_or_default().into(),
        element: cause["element"].as_str().map(str::to_owned),
        aliases: texts(&cause["aliases"]),
        parameters: parameters
            .filter_map(|parameter| {
                let name = parameter["name"].as_str()?.to_owned();
                let end = |place: usize| parameter["ci95"][place].as_f64();
                Some((name, parameter["value"].as_f64()?, [end(0)?, end(1)?]))
            })
            .collect(),
    }
}
