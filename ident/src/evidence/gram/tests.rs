use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::super::linear::RunColumns;
use super::super::priors::OFF;
use super::super::unknown::UnknownColumns;
use super::*;

const ROWS: usize = 40;

fn drawn(random: &mut ChaCha8Rng, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(ROWS, columns, |_, _| random.random_range(-1.0..1.0))
}

/// What a point costs is what its residuals leave once the unknown takes its best part of them, nothing else moving: starts once moved with it, so
/// that no step led to where all that is linear said.
#[test]
fn point_costs_what_the_unknown_leaves_of_its_residuals() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let own_precision = DMatrix::from_diagonal_element(4, 4, 2.0);
    let runs: Vec<RunColumns> = (0..2)
        .map(|_| RunColumns {
            residuals: drawn(&mut random, 1).column(0).into_owned(),
            base: drawn(&mut random, 3),
            numbers: Vec::new(),
            slips: drawn(&mut random, 3),
            unknown: Some(UnknownColumns { weights: drawn(&mut random, 2), own: drawn(&mut random, 4) }),
        })
        .collect();
    let beliefs = Beliefs {
        base: vec![1.0],
        starts: vec![vec![1.0; 2]; 2],
        stated_slip: 0.5,
        own: vec![(own_precision.clone(), -4.0 * 2f64.ln()); 2],
    };
    let standing = |_| Standing { base: vec![0.1], start: vec![0.2, -0.1], numbers: BTreeMap::new() };
    let standings: Vec<Standing> = (0..2).map(standing).collect();
    let gram = Gram::new(&runs, &standings, BTreeMap::new(), Arc::new(beliefs));
    for scales in [OFF, [3, 0, 0], [0, 3, 0], [3, 3, 2]] {
        let [weights, own] = [scales[0], scales[1]].map(|place| FORCE_SCALES[place]);
        let slip = SLIP_SCALES[scales[2]].hypot(0.5);
        // residuals of all runs, and the columns that may take their part of them: weights and slips in common, own forces by run
        let count = 2 + 3 + 2 * 4;
        let mut all = DMatrix::zeros(2 * ROWS, count);
        let mut residuals = DVector::zeros(2 * ROWS);
        let mut precision = DMatrix::zeros(count, count);
        for (run, columns) in runs.iter().enumerate() {
            let unknown = columns.unknown.as_ref().expect("there");
            residuals.rows_mut(run * ROWS, ROWS).copy_from(&columns.residuals);
            all.view_mut((run * ROWS, 0), (ROWS, 2)).copy_from(&(&unknown.weights * weights));
            all.view_mut((run * ROWS, 2), (ROWS, 3)).copy_from(&(&columns.slips * slip));
            all.view_mut((run * ROWS, 5 + 4 * run), (ROWS, 4)).copy_from(&(&unknown.own * own));
            precision.view_mut((5 + 4 * run, 5 + 4 * run), (4, 4)).copy_from(&own_precision);
        }
        precision.view_mut((0, 0), (5, 5)).fill_with_identity();
        let with = all.tr_mul(&residuals);
        let factor = (all.tr_mul(&all) + precision).cholesky().expect("positive");
        let left = residuals.norm_squared() - with.dot(&factor.solve(&with));
        let cost = gram.reduced(scales).expect("positive").cost;
        assert!((cost / left - 1.0).abs() < 1e-6, "{scales:?}: {cost} {left}");
    }
}
