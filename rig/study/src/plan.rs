//! `STUDY.toml`, and the tasks that it makes.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use app::{Failure, base};
use ground::strict::{self, Finite, Positive};
use serde::{Deserialize, Serialize};

use crate::carry_out::experiment;
use crate::glob::matching;
use crate::inputs::{Conditions, conditions, digest, digest_of};
use crate::task::{By, Does, Resample, Task, VERSION};

/// `STUDY.toml`. Relative paths start at the file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// What each task makes of its experiment.
    #[serde(default)]
    pub does: Does,
    /// The experiments.
    pub experiment: Vec<Group>,
    /// What is done with each; left out: the experiments as they are.
    #[serde(default)]
    pub variation: Vec<Variation>,
    /// What a task may take.
    #[serde(default)]
    pub task: Limits,
    /// What Slurm is told besides.
    #[serde(default)]
    pub slurm: Options,
    /// What HyperQueue is told besides.
    #[serde(default)]
    pub hyperqueue: Options,
}

/// Experiments, with what is known of them and stands in none of their files.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Run folders or experiments' files; `*` and `?` as in a shell.
    pub paths: Vec<String>,
    /// Which tank it was.
    pub tank: Option<String>,
    /// Which specimen it was.
    pub mechanism: Option<String>,
    /// Of the water, where the files do not say it or say it wrongly \[°C\].
    pub temperature_c: Option<Finite>,
}

/// What is done with an experiment.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variation {
    /// Its name.
    pub name: String,
    /// Another model than the experiment's.
    pub model: Option<PathBuf>,
    /// Keys of `[fit]` that are otherwise than the experiment's.
    #[serde(default)]
    pub fit: toml::Table,
    /// Keys of `[diagnose]` that are otherwise.
    #[serde(default)]
    pub diagnose: toml::Table,
    /// One task for each of these seeds of the fit.
    #[serde(default)]
    pub seeds: Vec<u64>,
    /// A bootstrap.
    pub resample: Option<Bootstrap>,
}

/// A bootstrap: so many draws beside the data as they are.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bootstrap {
    /// What is drawn.
    pub by: By,
    /// How many draws.
    pub count: u32,
    /// Seed of the draws.
    #[serde(default = "one")]
    pub seed: u64,
    /// Length of a block \[s\].
    #[serde(default = "block_s")]
    pub block_s: Positive,
}

fn one() -> u64 {
    1
}

/// Longer than residuals of a film stay alike (measured on the mock's runs: one to four images of 10 ms), shorter than a stroke.
fn block_s() -> Positive {
    Positive::literal(0.1)
}

/// What a task may take.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Threads.
    pub threads: usize,
    /// Longest time \[s\].
    pub limit_s: Positive,
    /// Memory that an engine reserves for it \[MiB\].
    pub memory_mib: u64,
    /// How often it may die before it is set aside.
    pub tries: usize,
    /// How long one usually takes \[s\], until that is measured: engines put short ones together.
    pub typical_s: Option<Positive>,
}

impl Default for Limits {
    fn default() -> Self {
        Self { threads: 1, limit_s: Positive::literal(3600.0), memory_mib: 1024, tries: 3, typical_s: None }
    }
}

/// What an engine is told besides.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Options of its command that submits: a partition, an account.
    pub options: Vec<String>,
}

/// An experiment of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// As the study names it.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// What is known of how it was recorded.
    pub conditions: Conditions,
}

/// A study as a list.
#[derive(Debug)]
pub struct Plan {
    /// Its experiments.
    pub subjects: Vec<Subject>,
    /// Its tasks, with their names: experiment by experiment, variation by variation.
    pub tasks: Vec<(String, Task)>,
}

impl StudyFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`Failure::Input`], with the line where one is at fault.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let mut file: Self = strict::read(path).map_err(Failure::input)?;
        if file.variation.is_empty() {
            let name = "as it is".into();
            file.variation.push(Variation {
                name,
                model: None,
                fit: toml::Table::new(),
                diagnose: toml::Table::new(),
                seeds: Vec::new(),
                resample: None,
            });
        }
        file.check().map_err(|error| Failure::Input(error.context(path.display().to_string())))?;
        Ok(file)
    }

    fn check(&self) -> anyhow::Result<()> {
        let mut names: Vec<&str> = self.variation.iter().map(|variation| variation.name.as_str()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            anyhow::bail!("two [[variation]] are called `{}`: results could not be told apart", twice[0]);
        }
        for variation in &self.variation {
            let by = variation.resample.as_ref().map(|bootstrap| bootstrap.by);
            if by == Some(By::Block) && self.does == Does::Diagnose {
                anyhow::bail!(
                    "[[variation]] `{}`: blocks are drawn from the residuals of a fit, and a diagnosis asks what those residuals are; resample \
                     by \"run\"",
                    variation.name
                );
            }
        }
        let limits = &self.task;
        if limits.threads == 0 || limits.tries == 0 || limits.memory_mib == 0 {
            anyhow::bail!("[task] threads, tries and memory_mib must be 1 or more");
        }
        Ok(())
    }

    /// All tasks of this study, which was read from `path`.
    ///
    /// # Errors
    /// [`Failure::Input`] where a path names nothing, a file cannot be read, or a variation does not go with the first experiment.
    pub fn plan(&self, path: &Path) -> Result<Plan, Failure> {
        let home = base(path).canonicalize().with_context(|| path.display().to_string());
        let home = home.map_err(Failure::Input)?;
        let models = self.variation.iter().map(|variation| self.model(variation, &home));
        let models = models.collect::<Result<Vec<_>, _>>()?;
        let mut plan = Plan { subjects: Vec::new(), tasks: Vec::new() };
        let mut seen = std::collections::BTreeSet::new();
        for group in &self.experiment {
            for pattern in &group.paths {
                let found = matching(pattern, &home);
                if found.is_empty() {
                    return Err(Failure::Input(anyhow!(
                        "{}: [[experiment]] paths: nothing is called `{pattern}`, seen from {}",
                        path.display(),
                        home.display()
                    )));
                }
                for place in found.into_iter().filter(|place| is_experiment(place)) {
                    if seen.insert(place.clone()) {
                        self.add(group, &place, &home, &models, &mut plan)?;
                    }
                }
            }
        }
        if plan.tasks.is_empty() {
            return Err(Failure::Input(anyhow!(
                "{}: none of the [[experiment]] paths is a run folder or an experiment's file",
                path.display()
            )));
        }
        self.try_on_first(&plan)?;
        Ok(plan)
    }

    fn model(&self, variation: &Variation, home: &Path) -> Result<Option<(PathBuf, String)>, Failure> {
        let read = |model: &PathBuf| {
            let path = home.join(model);
            let text = std::fs::read(&path).with_context(|| {
                format!("reading the model of [[variation]] `{}`, {}", variation.name, path.display())
            });
            text.map(|text| (path, digest_of(&text))).map_err(Failure::Input)
        };
        variation.model.as_ref().map(read).transpose()
    }

    fn add(
        &self,
        group: &Group,
        place: &Path,
        home: &Path,
        models: &[Option<(PathBuf, String)>],
        plan: &mut Plan,
    ) -> Result<(), Failure> {
        let inputs_sha256 = digest(place)?;
        let name = place.strip_prefix(home).unwrap_or(place).display().to_string();
        let known = conditions(place);
        let subject = Subject {
            name: name.clone(),
            path: place.into(),
            conditions: Conditions {
                began_utc: known.began_utc,
                temperature_c: group.temperature_c.map(Finite::get).or(known.temperature_c),
                tank: group.tank.clone(),
                mechanism: group.mechanism.clone(),
            },
        };
        plan.subjects.push(subject);
        for (variation, model) in self.variation.iter().zip(models) {
            let seeds: Vec<Option<u64>> = match variation.seeds[..] {
                [] => vec![None],
                _ => variation.seeds.iter().copied().map(Some).collect(),
            };
            let draws = variation.resample.as_ref().map_or(0, |bootstrap| bootstrap.count);
            for seed in seeds {
                for number in 0..=draws {
                    let resample =
                        variation.resample.as_ref().filter(|_| number > 0).map(|bootstrap| Resample {
                            by: bootstrap.by,
                            number,
                            seed: bootstrap.seed,
                            block_s: bootstrap.block_s.get(),
                        });
                    let task = Task {
                        version: VERSION.into(),
                        does: self.does,
                        experiment: name.clone(),
                        path: place.into(),
                        inputs_sha256: inputs_sha256.clone(),
                        variation: variation.name.clone(),
                        model: model.as_ref().map(|(path, _)| path.clone()),
                        model_sha256: model.as_ref().map(|(_, digest)| digest.clone()),
                        fit: variation.fit.clone(),
                        diagnose: variation.diagnose.clone(),
                        seed,
                        resample,
                        threads: self.task.threads,
                        limit_s: self.task.limit_s.get(),
                        tries: self.task.tries,
                    };
                    plan.tasks.push((task.id()?, task));
                }
            }
        }
        Ok(())
    }

    /// Reads the first experiment as each variation has it: a word that is misspelt is said before a thousand tasks fail of it.
    fn try_on_first(&self, plan: &Plan) -> Result<(), Failure> {
        let first = &plan.tasks[0].1.experiment;
        for variation in &self.variation {
            let mut tasks = plan.tasks.iter().map(|(_, task)| task);
            let made = tasks.find(|task| task.experiment == *first && task.variation == variation.name);
            let Some(task) = made else { continue };
            experiment(task).map_err(|failure| {
                let status = failure.status();
                let context = format!("[[variation]] `{}` on {first}", variation.name);
                match failure {
                    Failure::Input(error) | Failure::Data(error) => {
                        Failure::of(status, error.context(context))
                    }
                    other => other,
                }
            })?;
        }
        Ok(())
    }
}

/// Whether a run folder or a TOML file is there; other things that a star meets are passed over.
fn is_experiment(place: &Path) -> bool {
    match place.is_dir() {
        true => place.join(record::folder::file::START).is_file(),
        false => place.extension().is_some_and(|ending| ending == "toml"),
    }
}
