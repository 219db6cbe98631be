//! All results of a study put together: the table, what it says, and the page. Nothing in them depends on when, where or in which order the tasks
//! were done.

use std::collections::BTreeMap;
use std::path::Path;

use app::Failure;
use app::compose::EXPERIMENT;
use ground::shell::word;
use report::{Disagreement, SetAside, StudyFindings, StudySize, ToSettle, VerdictCount, render_study};

use crate::findings::Gathered;
use crate::folder::{FINDINGS, PARQUET, REPORT, Study, StudyFolder, TABLE};
use crate::inputs::Conditions;
use crate::plan::Subject;
use crate::table::Table;
use crate::task::{Task, VERSION};

/// Pairs of experiments for which commands are given, at most.
const MOST_TO_SETTLE: usize = 3;

/// Collects `study`, whose folder is `folder`; gives what was found.
///
/// # Errors
/// [`Failure::Input`] where a file cannot be read or written.
pub fn collect(folder: &StudyFolder, study: &Study) -> Result<StudyFindings, Failure> {
    let subjects: BTreeMap<&str, usize> =
        study.experiments.iter().enumerate().map(|(place, subject)| (subject.name.as_str(), place)).collect();
    let mut table = Table::begin(folder.begin_collected(TABLE)?, folder.begin_collected(PARQUET)?)?;
    let mut gathered = Gathered::default();
    let mut verdicts: BTreeMap<(usize, String), usize> = BTreeMap::new();
    let (mut done, mut set_aside, mut unended) = (0, Vec::new(), 0);
    for id in &study.tasks {
        let task = Task::read(&folder.task(id))?;
        let place = subjects.get(task.experiment.as_str()).copied();
        let variation = study.variations.iter().position(|name| *name == task.variation);
        let (Some(place), Some(variation)) = (place, variation) else { continue };
        let Some(result) = folder.result(id)? else {
            if let Some(why) = folder.set_aside(id) {
                set_aside.push(SetAside { task: id.clone(), words: task.words(), why });
            }
            continue;
        };
        done += 1;
        let verdict = result.verdict.as_deref();
        for number in &result.numbers {
            table.add((id, &task), &study.experiments[place], verdict, number)?;
        }
        if let Some(verdict) = verdict.filter(|_| task.resample.is_none()) {
            *verdicts.entry((variation, verdict.to_owned())).or_default() += 1;
        }
        unended += usize::from(result.diagnosis.as_ref().is_some_and(|diagnosis| !diagnosis.complete));
        gathered.add(place, variation, &task, &result);
    }
    table.finish()?;
    let names: Vec<String> = study.experiments.iter().map(|subject| subject.name.clone()).collect();
    let conditions: Vec<&Conditions> = study.experiments.iter().map(|subject| &subject.conditions).collect();
    let (trends, trends_sought) = gathered.trends(&conditions, &study.variations);
    let (disagreements, pairs_compared) = gathered.disagreements(&names, &study.variations);
    let mut warnings = Vec::new();
    if unended > 0 {
        warnings.push(format!(
            "{unended} diagnoses were ended by their time limit, so another machine may say otherwise: raise `diagnose = {{ limit_s = ... }}`"
        ));
    }
    let found = StudyFindings {
        name: study.study.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        rig_version: VERSION.into(),
        size: StudySize {
            experiments: names.len(),
            variations: study.variations.len(),
            tasks: study.tasks.len(),
            done,
        },
        warnings,
        common: gathered.common(&names, &study.variations),
        trends,
        trends_sought,
        twins: gathered.twins(&study.variations),
        to_settle: to_settle(&disagreements, &study.experiments),
        disagreements,
        pairs_compared,
        shifts: gathered.shifts(&study.variations),
        verdicts: verdicts
            .into_iter()
            .map(|((variation, verdict), count)| VerdictCount {
                variation: study.variations[variation].clone(),
                verdict,
                count,
            })
            .collect(),
        set_aside,
    };
    let mut json = serde_json::to_vec_pretty(&found).map_err(Failure::internal)?;
    json.push(b'\n');
    folder.write_collected(FINDINGS, &json)?;
    folder.write_collected(REPORT, render_study(&found).as_bytes())?;
    Ok(found)
}

/// For the pairs that disagree most: the diagnosis of both together, which says what differs, and the runs that would tell.
fn to_settle(pairs: &[Disagreement], subjects: &[Subject]) -> Vec<ToSettle> {
    let mut all: Vec<ToSettle> = Vec::new();
    let mut seen: Vec<&[String; 2]> = Vec::new();
    for pair in pairs {
        if all.len() == MOST_TO_SETTLE {
            break;
        }
        if seen.contains(&&pair.experiments) {
            continue;
        }
        seen.push(&pair.experiments);
        let place =
            |name: &String| subjects.iter().find(|subject| subject.name == *name).map(|it| it.path.as_path());
        let places: Vec<&Path> = pair.experiments.iter().filter_map(place).collect();
        let commands = match places[..] {
            [one, other] if one.is_dir() && other.is_dir() => vec![
                format!("rig experiment {} {} --out both/{EXPERIMENT}", word(one), word(other)),
                format!("rig diagnose both/{EXPERIMENT} --out both"),
                format!("rig design both/{EXPERIMENT}"),
            ],
            _ => places
                .iter()
                .filter(|place| place.is_file())
                .map(|place| format!("rig design {}", word(place)))
                .collect(),
        };
        let [one, other] = &pair.experiments;
        let question = format!("{} is {:.1} sigma apart between {one} and {other}:", pair.name, pair.sigmas);
        all.push(ToSettle { question, commands });
    }
    all
}
