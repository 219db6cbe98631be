//! Tanks for campaigns: a servo that is not what its model says, and a first run that is too gentle to tell.

use std::path::{Path, PathBuf};

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::{changed_config, config, rig, set};

/// The config, whose tank is changed.
const RIG: &str = "chain-driven-late.toml";
/// A machine that is busy with other tests takes longer to find what it finds in a minute.
const DIAGNOSIS_LIMIT_S: f64 = 120.0;
/// The servo's lag where none is hidden \[s\].
const KNOWN_LAG_S: f64 = 0.025;
/// How often it looks at its pulse \[s\]: as often as the board changes it, it would be late by another time in each run.
const FINE_PERIOD_S: f64 = 1e-4;
/// A pulse is held until the board changes it, every millisecond: so late the servo truly is beside what is hidden, at most \[s\].
const HELD_S: f64 = 1e-3;

/// What is hidden in a tank.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hidden {
    /// The servo creeps after its command, with this time constant \[s\].
    Lag(f64),
    /// The servo does what it is told so much later \[s\].
    Delay(f64),
}

/// A tank with a rig.
#[derive(Debug)]
pub struct Tank {
    /// The rig's config, with `runs` beside it.
    pub config: PathBuf,
    folder: PathBuf,
}

impl Hidden {
    /// Either, of 10 to 30 ms, by `seed`.
    pub fn drawn(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let time_s = random.random_range(0.01..0.03);
        if seed.is_multiple_of(2) { Self::Lag(time_s) } else { Self::Delay(time_s) }
    }

    /// The cause that a diagnosis should name.
    pub fn cause(self) -> &'static str {
        match self {
            Self::Lag(_) => "servo_lag",
            Self::Delay(_) => "servo_delay",
        }
    }
}

impl Tank {
    /// A tank in `folder` with `hidden` in it, its water's coefficients and its first run's strokes drawn by `seed`. Where no lag is hidden its
    /// servo lags too, and the rig's fit has that lag: a servo without any would shake dry friction loose with each step of its pulse.
    ///
    /// # Panics
    /// Where the shipped tank cannot be read, or the folder not be written.
    pub fn new(folder: &Path, hidden: Option<Hidden>, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x7A4B);
        let tanks = config("tanks");
        let read = |name: &str| std::fs::read_to_string(tanks.join(name)).expect("a shipped tank");
        let mut model = read("chain-driven-hanging.xml");
        // each fluid coefficient up to 30 % to either side
        let mut scaled = String::new();
        while let Some(place) = model.find("fluidcoef=\"") {
            let rest = model.split_off(place + "fluidcoef=\"".len());
            let (numbers, after) = rest.split_once('"').expect("an attribute ends");
            let numbers: Vec<String> = numbers
                .split_whitespace()
                .map(|number| number.parse::<f64>().expect("a number"))
                .map(|number| (number * random.random_range(0.7..1.3)).to_string())
                .collect();
            scaled += &format!("{model}{}\"", numbers.join(" "));
            model = after.to_owned();
        }
        std::fs::write(folder.join("tank.xml"), scaled + &model).expect("a tank's model");

        let mut tank: toml::Table = read(RIG).parse().expect("a tank");
        tank.insert("model".into(), "tank.xml".into());
        tank.insert("seed".into(), i64::try_from(seed).expect("a small seed").into());
        let servos = tank["servo"].as_array_mut().expect("servos");
        let servo = servos[0].as_table_mut().expect("a servo");
        let lag_s = match hidden {
            Some(Hidden::Lag(time_s)) => time_s,
            _ => KNOWN_LAG_S,
        };
        servo.insert("period_s".into(), FINE_PERIOD_S.into());
        servo.insert("lag_s".into(), lag_s.into());
        if let Some(Hidden::Delay(delay_s)) = hidden {
            let delay: toml::Table = [("delay".to_owned(), delay_s.into())].into_iter().collect();
            set(&mut tank, "causes", "servo_delay", delay);
        }
        std::fs::write(folder.join("tank.toml"), tank.to_string()).expect("a tank");

        let config = changed_config(RIG, folder, |config| {
            set(config, "mock", "tank", "tank.toml");
            set(config, "profile", "amplitude_rad", random.random_range(0.3..0.5));
            set(config, "diagnose", "limit_s", DIAGNOSIS_LIMIT_S);
            if !matches!(hidden, Some(Hidden::Lag(_))) {
                let parameters = config["fit"]["parameters"].as_array_mut().expect("parameters");
                parameters.push("servo_lag/time".into());
            }
        });
        Self { config, folder: folder.into() }
    }

    /// The folder of run folders.
    pub fn runs(&self) -> PathBuf {
        self.folder.join("runs")
    }

    /// The folder of its campaign.
    pub fn out(&self) -> PathBuf {
        self.folder.join("campaign")
    }

    /// `rig campaign` on it, with more arguments.
    pub fn campaign(&self, more: &[&str]) -> std::process::Command {
        let mut command = rig(["campaign"]);
        command.arg(&self.config).args(more);
        command.arg("--runs-dir").arg(self.runs()).arg("--out").arg(self.out());
        command
    }

    /// Its `campaign.json`.
    pub fn record(&self) -> Value {
        crate::json(&self.out().join("campaign.json"))
    }

    /// Whether the last diagnosis names `hidden` and nothing else but how long pulses are held; by its own name, or by one that no film tells from it.
    pub fn names(&self, hidden: Hidden) -> bool {
        matches!(&self.named()[..], [names] if names.iter().any(|name| name == hidden.cause()))
    }

    /// The causes that the last diagnosis names, or those beyond doubt where it does not explain all; each with its aliases behind it.
    pub fn named(&self) -> Vec<Vec<String>> {
        let steps = self.record()["steps"].as_array().map_or(0, Vec::len);
        let diagnosis = crate::json(&self.out().join(format!("after-{steps}/diagnosis.json")));
        let list = if diagnosis["verdict"] == "unexplained" { "established" } else { "causes" };
        let causes = diagnosis[list].as_array().cloned().unwrap_or_default();
        let text = |name: &Value| name.as_str().map(str::to_owned);
        let names = |cause: &Value| {
            let aliases = cause["aliases"].as_array().into_iter().flatten();
            std::iter::once(&cause["name"]).chain(aliases).filter_map(text).collect()
        };
        let is_held = |cause: &&Value| {
            let mut parameters = cause["parameters"].as_array().into_iter().flatten();
            parameters.all(|parameter| {
                let is_delay = parameter["name"].as_str().is_some_and(|name| name.contains("_delay/"));
                is_delay && parameter["value"].as_f64().is_some_and(|value_s| value_s.abs() < HELD_S)
            })
        };
        causes.iter().filter(|cause| !is_held(cause)).map(names).collect()
    }
}
