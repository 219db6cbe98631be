//! Strategy constants of the tutorial's table 1, a function of dimension and population alone.

/// Learning rates and recombination weights; names as in the tutorial.
pub(super) struct Constants {
    /// Recombination weights by rank, shape (population): the positive ones add up to 1, the worse half is negative.
    pub(super) weights: Vec<f64>,
    pub(super) mu_eff: f64,
    pub(super) c_sigma: f64,
    pub(super) d_sigma: f64,
    pub(super) c_c: f64,
    pub(super) c_1: f64,
    pub(super) c_mu: f64,
    /// Expected length of a standard normal vector.
    pub(super) expected_length: f64,
}

impl Constants {
    pub(super) fn new(dimension: usize, population: usize) -> Self {
        let n = dimension as f64;
        let raw: Vec<f64> = (1..=population)
            .map(|rank| ((population as f64 + 1.0) / 2.0).ln() - (rank as f64).ln())
            .collect();
        let (good, bad) = raw.split_at(population / 2);
        let effective = |w: &[f64]| w.iter().sum::<f64>().powi(2) / w.iter().map(|w| w * w).sum::<f64>();
        let (mu_eff, mu_eff_bad) = (effective(good), effective(bad));

        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let d_sigma = 1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let c_c = (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n);
        let c_1 = 2.0 / ((n + 1.3).powi(2) + mu_eff);
        let c_mu = (1.0 - c_1).min(2.0 * (0.25 + mu_eff + 1.0 / mu_eff - 2.0) / ((n + 2.0).powi(2) + mu_eff));

        let most_negative = (1.0 + c_1 / c_mu)
            .min(1.0 + 2.0 * mu_eff_bad / (mu_eff + 2.0))
            .min((1.0 - c_1 - c_mu) / (n * c_mu));
        let good_sum: f64 = good.iter().sum();
        let bad_sum: f64 = bad.iter().map(|w| w.abs()).sum();
        let scaled = |w: &f64| if *w >= 0.0 { w / good_sum } else { w * most_negative / bad_sum };
        Self {
            weights: raw.iter().map(scaled).collect(),
            mu_eff,
            c_sigma,
            d_sigma,
            c_c,
            c_1,
            c_mu,
            expected_length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}
