//! What may be wrong with the files of all runs alike, each as the way to put it right. A further one is a line in [`all`].

use std::f64::consts::PI;

use sim::Command;

use crate::experiment::{Experiment, Run, RunKind};

/// A way in which files describe runs wrongly.
#[derive(Debug, Clone)]
pub(super) struct Mistake {
    /// Its place in the list of all, in which the simplest of each kind stands first.
    pub(super) place: usize,
    /// As `diagnosis.json` spells it.
    pub(super) name: &'static str,
    /// What would be so.
    pub(super) sentence: String,
    /// What to do about it.
    pub(super) check: String,
    /// Whether only one that leaves nothing but noise is worth saying: it has numbers that are fitted.
    pub(super) must_explain: bool,
    /// The experiment without the mistake.
    pub(super) mended: Experiment,
}

/// All mistakes that `experiment` could hold.
pub(super) fn all(experiment: &Experiment) -> Vec<Mistake> {
    let mut list = axes(experiment);
    list.extend(orders(experiment));
    list.extend(servo(
        experiment,
        "servo-reversed",
        "the servo turns the other way than its table says (positive is counter-clockwise)",
        "reverse the sign of the servo table's angles",
        |command| command.angle_rad.iter_mut().for_each(|angle| *angle = -*angle),
    ));
    list.extend(servo(
        experiment,
        "servo-degrees",
        "the servo table's angles are in degrees",
        "multiply the servo table's angles by pi / 180",
        |command| command.angle_rad.iter_mut().for_each(|angle| *angle *= PI / 180.0),
    ));
    list.extend(servo(
        experiment,
        "servo-milliseconds",
        "the servo table's times are in milliseconds",
        "divide the servo table's time_s by 1000",
        |command| command.time_s.iter_mut().for_each(|time_s| *time_s /= 1000.0),
    ));
    list.extend(release(experiment));
    list.iter_mut().enumerate().for_each(|(place, mistake)| mistake.place = place);
    list
}

const AXES: [char; 3] = ['x', 'y', 'z'];

/// The experiment with each keypoint put elsewhere in its image; encoders stay.
fn with_marks(experiment: &Experiment, change: impl Fn(&mut [[f64; 3]])) -> Experiment {
    let mut mended = experiment.clone();
    for run in &mut mended.runs {
        let width = run.trajectory.keypoints.len().max(1);
        run.trajectory.position_m.chunks_exact_mut(width).for_each(&change);
    }
    mended
}

/// Whether any run shows the coordinates of keypoints along each axis.
fn seen(experiment: &Experiment) -> [bool; 3] {
    let places = || experiment.runs.iter().flat_map(|run| &run.trajectory.position_m);
    std::array::from_fn(|axis| places().any(|place| place[axis].is_finite()))
}

/// Axes exchanged, or counted the other way.
fn axes(experiment: &Experiment) -> Vec<Mistake> {
    // an encoder's angle has no axes
    if experiment
        .runs
        .iter()
        .flat_map(|run| &run.trajectory.keypoints)
        .any(|name| sim::model::encoded_joint(name).is_some())
    {
        return Vec::new();
    }
    let seen = seen(experiment);
    let mut list = Vec::new();
    for from in [[0, 1, 2], [2, 1, 0], [0, 2, 1], [1, 0, 2]] {
        let changed = (0..3).find(|&axis| from[axis] != axis);
        // which two are exchanged is of no matter where neither is seen
        if changed.is_some_and(|axis| !seen[axis] && !seen[from[axis]]) {
            continue;
        }
        let flips =
            (0..8_usize).filter(|flips| (0..3).all(|axis| flips >> axis & 1 == 0 || seen[from[axis]]));
        for flips in flips.filter(|&flips| flips > 0 || changed.is_some()) {
            let is_flipped = |axis: usize| flips >> axis & 1 == 1;
            let mended = with_marks(experiment, |marks| {
                for mark in marks {
                    let there = *mark;
                    *mark = std::array::from_fn(|axis| {
                        if is_flipped(axis) { -there[from[axis]] } else { there[from[axis]] }
                    });
                }
            });
            let mut said = Vec::new();
            if let Some(axis) = changed {
                let (a, b) = (AXES[axis], AXES[from[axis]]);
                said.push(match (seen[axis], seen[from[axis]]) {
                    (true, true) => format!("{a} and {b} are exchanged"),
                    (false, _) => format!("what is called {b} is {a}"),
                    (_, false) => format!("what is called {a} is {b}"),
                });
            }
            for axis in (0..3).filter(|&axis| is_flipped(axis)) {
                said.push(match AXES[axis] {
                    'z' => "z counts downward, as picture rows do, instead of upward".to_owned(),
                    other => format!("{other} is mirrored: it counts the other way"),
                });
            }
            list.push(Mistake {
                place: 0,
                name: "axes",
                sentence: said.join(" and "),
                check: "put the columns of the trajectory tables right: x to the right, z upward, both from the world's origin".into(),
                must_explain: false,
                mended,
            });
        }
    }
    list
}

/// Keypoints in another order than their names say, the same in all runs.
fn orders(experiment: &Experiment) -> Vec<Mistake> {
    let Some(first) = experiment.runs.first() else { return Vec::new() };
    let names = &first.trajectory.keypoints;
    let is_same = |run: &Run| run.trajectory.keypoints == *names;
    if names.len() < 2 || !experiment.runs.iter().all(is_same) {
        return Vec::new();
    }
    let last = names.len() - 1;
    let reversed: Option<(String, Vec<usize>)> = (last > 1).then(|| {
        let sentence =
            format!("the keypoints' order is reversed: `{}` is `{}`, and so on", names[0], names[last]);
        (sentence, (0..=last).rev().collect())
    });
    let pairs =
        (0..=last).flat_map(|a| (0..a).map(move |b| (b, a))).filter(|pair| last == 1 || *pair != (0, last));
    let exchanged = pairs.map(|(a, b)| {
        let mut order: Vec<usize> = (0..=last).collect();
        order.swap(a, b);
        (format!("the labels `{}` and `{}` are exchanged", names[a], names[b]), order)
    });
    let mistake = |(sentence, order): (String, Vec<usize>)| Mistake {
        place: 0,
        name: "order",
        sentence,
        check: "put the names of the trajectory tables' columns right".into(),
        must_explain: false,
        mended: with_marks(experiment, |marks| {
            let there = marks.to_vec();
            order.iter().zip(marks).for_each(|(&from, mark)| *mark = there[from]);
        }),
    };
    reversed.into_iter().chain(exchanged).map(mistake).collect()
}

/// What `put_right` does to the servo tables.
fn servo(
    experiment: &Experiment,
    name: &'static str,
    sentence: &str,
    check: &str,
    put_right: impl Fn(&mut Command),
) -> Option<Mistake> {
    let mut mended = experiment.clone();
    let mut commands = mended.runs.iter_mut().filter_map(|run| run.command.as_mut()).peekable();
    commands.peek()?;
    commands.for_each(put_right);
    Some(Mistake {
        place: 0,
        name,
        sentence: sentence.into(),
        check: check.into(),
        must_explain: false,
        mended,
    })
}

/// Drops that were let go at another time than is stated. Drops alone do not tell that from a camera's clock, which is a cause.
fn release(experiment: &Experiment) -> Option<Mistake> {
    let has_other_starts =
        experiment.runs.iter().any(|run| run.kind != RunKind::Drop || run.release_s.is_none());
    let mut mended = experiment.clone();
    let is_stated = |run: &&mut Run| run.kind == RunKind::Drop && run.release_s.is_some();
    let stated = mended.runs.iter_mut().filter(is_stated).map(|run| run.release_s = None).count();
    (stated > 0 && has_other_starts).then(|| Mistake {
        place: 0,
        name: RELEASE,
        sentence: "the release is not when `release_s` says".into(),
        check: "delete `release_s` (the release is then found in the images and fitted), or state it as the pictures' clock has it".into(),
        must_explain: true,
        mended,
    })
}

/// The name of a release that is stated wrongly.
pub(super) const RELEASE: &str = "release";
