use super::*;

fn search(start: &[f64], options: Options, loss: impl Fn(&[f64]) -> f64) -> CmaEs {
    let mut es = CmaEs::new(start, options);
    while es.stop().is_none() {
        let generation = es.ask();
        let losses: Vec<f64> = generation.points.iter().map(|x| loss(x)).collect();
        es.tell(&generation, &losses);
    }
    es
}

fn valley(x: &[f64]) -> f64 {
    x.windows(2).map(|p| 100.0 * (p[0] * p[0] - p[1]).powi(2) + (p[0] - 1.0).powi(2)).sum()
}

#[test]
fn candidates_stay_in_the_box_and_find_an_optimum_on_its_edge() {
    // The unconstrained optimum lies outside in the first two coordinates.
    let loss = |x: &[f64]| {
        assert!(x.iter().all(|x| (0.0..=1.0).contains(x)), "{x:?}");
        (x[0] + 0.5).powi(2) + (x[1] - 1.3).powi(2) + (x[2] - 0.4).powi(2) + (x[0] - x[2]).powi(2)
    };
    let es = search(&[0.5; 3], Options { unit_box: true, ..Options::default() }, loss);
    let (best, _) = es.best().unwrap();
    // With x0 = 0: (x2 - 0.4)^2 + x2^2 is least at 0.2.
    for (found, wanted) in best.iter().zip([0.0, 1.0, 0.2]) {
        assert!((found - wanted).abs() < 1e-4, "{best:?}");
    }
}

#[test]
fn saved_search_goes_on_to_the_identical_end() {
    let options = Options { max_evaluations: 600, seed: 5, ..Options::default() };
    let whole = search(&[0.0; 4], options.clone(), valley);
    let mut es = CmaEs::new(&[0.0; 4], options);
    while es.stop().is_none() {
        let text = serde_json::to_string(&es).unwrap();
        es = serde_json::from_str(&text).unwrap();
        let generation = es.ask();
        let losses: Vec<f64> = generation.points.iter().map(|x| valley(x)).collect();
        es.tell(&generation, &losses);
    }
    assert_eq!(serde_json::to_string(&es).unwrap(), serde_json::to_string(&whole).unwrap());
}

#[test]
fn each_reason_to_stop_is_named() {
    let start = [1.0; 3];
    let sphere = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let base = Options { tol_loss: 0.0, tol_step: 0.0, max_evaluations: 100_000, ..Options::default() };
    let stop = |options: Options, loss: &dyn Fn(&[f64]) -> f64| search(&start, options, loss).stop().unwrap();
    assert_eq!(stop(Options { target: Some(1e-3), ..base.clone() }, &sphere), Stop::Target);
    assert_eq!(stop(Options { max_evaluations: 50, ..base.clone() }, &sphere), Stop::MaxEvaluations);
    assert_eq!(stop(Options { tol_loss: 1e-6, ..base.clone() }, &sphere), Stop::TolLoss);
    assert_eq!(stop(Options { tol_loss_share: 0.5, ..base.clone() }, &|x| 1.0 + sphere(x)), Stop::TolLoss);
    assert_eq!(stop(Options { tol_step: 1e-3, ..base.clone() }, &sphere), Stop::TolStep);
    assert_eq!(stop(base.clone(), &|x| x[0]), Stop::Diverged);
    assert_eq!(stop(base.clone(), &|_| f64::NAN), Stop::Stagnation);
    assert_eq!(stop(base.clone(), &|x| (x[0] - 1.0).powi(2) + 1e16 * sphere(&x[1..])), Stop::Condition);
    assert_eq!(stop(base, &|x| (x[0] - 1e9).abs() + 1e3 * sphere(&x[1..])), Stop::Diverged);
}

#[test]
fn budget_is_never_exceeded() {
    let es = search(&[0.0; 4], Options { max_evaluations: 100, ..Options::default() }, valley);
    assert!(es.evaluations() <= 100 && es.evaluations() > 90);
}

#[test]
fn candidates_that_fail_are_avoided() {
    // Half the plane has no loss at all, and the optimum lies close to its edge.
    let loss = |x: &[f64]| if x[0] < 0.0 { f64::NAN } else { (x[0] - 0.01).powi(2) + x[1] * x[1] };
    let es = search(&[1.0, 1.0], Options::default(), loss);
    assert!(es.best().unwrap().1 < 1e-9);
}
