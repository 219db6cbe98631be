use super::*;
use crate::config::FitConfig;
use ground::strict::{Finite, Positive};

const MODEL: &str = r#"<mujoco model="two">
  <option density="1000"/>
  <default><geom fluidshape="ellipsoid"/></default>
  <worldbody>
    <geom name="stand" type="box" size="0.01 0.01 0.01"/>
    <body name="l1">
      <joint name="j1" axis="0 -1 0" damping="1e-6"/>
      <geom name="g1" type="box" size="0.005 0.003 0.01" pos="0 0 -0.01"/>
      <body name="l2" pos="0 0 -0.02">
        <joint name="j2" axis="0 -1 0" damping="3e-6"/>
        <geom name="g2" type="box" size="0.005 0.003 0.01" pos="0 0 -0.01" fluidcoef="0.7 0.2 1.6 0.9 12"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="j1" kp="0.1"/></actuator>
</mujoco>"#;

fn model() -> Model {
    Model::from_mjcf(MODEL).unwrap()
}

fn select(text: &str) -> Result<Parameters, String> {
    let config: FitConfig = toml::from_str(text).unwrap();
    Parameters::select(&model(), &config).map_err(|error| error.to_string())
}

fn names(text: &str) -> Vec<String> {
    select(text).unwrap().free.iter().map(|parameter| parameter.names.join("+")).collect()
}

fn find<'a>(parameters: &'a Parameters, name: &str) -> &'a FreeParameter {
    parameters.free.iter().find(|parameter| parameter.name() == name).unwrap()
}

#[test]
fn kinds_mean_moving_geoms_and_passive_joints() {
    let five = |geom: &str| ["blunt", "slender", "angular", "kutta", "magnus"].map(|c| format!("{geom}/{c}"));
    let mut wanted = [five("g1"), five("g2")].concat();
    wanted.extend(["j2/damping".into(), "j2/frictionloss".into()]);
    assert_eq!(names(""), wanted);
    assert_eq!(names("parameters = [\"kutta\", \"gain\"]"), ["g1/kutta", "g2/kutta", "servo/gain"]);
    assert_eq!(names("parameters = []"), [""; 0]);
}

#[test]
fn names_globs_fixed_ties_and_priors_choose() {
    assert_eq!(names("parameters = [\"j1/damping\", \"g?/blunt\"]"), ["g1/blunt", "g2/blunt", "j1/damping"]);
    assert_eq!(names("parameters = [\"kutta\"]\nfixed = [\"g1/*\"]"), ["g2/kutta"]);
    let tied = names("parameters = [\"kutta\", \"blunt\"]\ntie = [[\"kutta\"]]");
    assert_eq!(tied, ["g1/blunt", "g1/kutta+g2/kutta", "g2/blunt"]);
    assert_eq!(names("parameters = []\n[prior]\n\"l2/mass\" = { mean = 0.0006, std = 1e-5 }"), ["l2/mass"]);
}

#[test]
fn a_kind_that_only_driven_joints_have_is_pointed_out() {
    let driven =
        MODEL.replace("</actuator>", "<position name=\"second\" joint=\"j2\" kp=\"0.1\"/></actuator>");
    let config: FitConfig = toml::from_str("parameters = [\"damping\"]").unwrap();
    let error = Parameters::select(&Model::from_mjcf(&driven).unwrap(), &config).unwrap_err().to_string();
    let wanted =
        "names `damping`, which the model does not have (but of driven joints; ask for `j1/damping` by name)";
    assert!(error.ends_with(wanted), "{error}");
}

#[test]
fn values_go_to_every_tied_place_and_back() {
    let parameters = select("parameters = [\"kutta\", \"damping\"]\ntie = [[\"*/kutta\"]]").unwrap();
    let mut model = model();
    parameters.apply(&[1.5, 4e-6], &mut model);
    for (name, value) in [("g1/kutta", 1.5), ("g2/kutta", 1.5), ("j2/damping", 4e-6), ("j1/damping", 1e-6)] {
        assert_eq!(model.parameter(name).unwrap(), value, "{name}");
    }
    let units = parameters.units(&[1.5, 4e-6]);
    for (value, back) in [1.5, 4e-6].iter().zip(parameters.values(&units)) {
        assert!((value - back).abs() < 1e-12 * value);
    }
}

#[test]
fn proportional_parameters_keep_the_ratios_of_the_model() {
    let text = "parameters = [\"kutta\", \"*/magnus\"]\nproportional = [[\"*/magnus\"]]\n[prior]\n\"g2/magnus\" = { mean = 6, std = 3 }";
    let parameters = select(text).unwrap();
    let mut model = model();
    parameters.apply(&[1.5, 0.25, 0.75], &mut model);
    for (name, value) in [("g1/kutta", 1.5), ("g2/kutta", 0.75), ("g1/magnus", 0.25), ("g2/magnus", 3.0)] {
        assert_eq!(model.parameter(name).unwrap(), value, "{name}");
    }
    assert_eq!(parameters.rates(), [vec![(0, 1.0)], vec![(1, 1.0), (2, 12.0)], vec![(3, 1.0)]]);
    assert_eq!(parameters.spread(&[1.5, 0.25, 0.75]), [1.5, 0.25, 3.0, 0.75]);
    let prior = Prior { mean: Finite::new(0.5).unwrap(), std: Positive::new(0.25).unwrap() };
    assert_eq!(parameters.free[1].prior, Some(prior), "stated of the second, twelve times the first");
}

#[test]
fn bounds_go_by_name_then_glob_then_kind_then_physics() {
    let text = "[bounds]\nfluidcoef = [0, 3]\nkutta = [0, 4]\n\"g2/*\" = [0, 20]\n\"g1/blunt\" = [0.5, 5]\n";
    let parameters = select(text).unwrap();
    let upper = |name: &str| find(&parameters, name).scale.upper();
    assert_eq!(["g1/blunt", "g2/blunt", "g1/kutta", "g1/slender"].map(upper), [5.0, 20.0, 4.0, 3.0]);
    // Two links of 1.2 g over 40 mm: 4e-6 kg m2, times 10 /s.
    assert!((3e-5..5e-5).contains(&upper("j2/damping")), "{}", upper("j2/damping"));
    // Without bounds the model's own value stays inside.
    assert!(find(&select("").unwrap(), "g2/magnus").scale.upper() > 12.0);
}

#[test]
fn a_fit_starts_at_the_prior_or_the_model_within_the_bounds() {
    let prior = "[prior]\n\"l1/mass\" = { mean = 0.0015, std = 1e-5 }";
    let parameters = select(&format!("[bounds]\nblunt = [0.0, 0.6]\n{prior}")).unwrap();
    let start = |name: &str| find(&parameters, name).start;
    assert_eq!([start("g2/blunt"), start("l1/mass"), start("j2/damping")], [0.6, 0.0015, 3e-6]);
    assert!(start("j2/frictionloss") > 0.0, "exactly no friction has no slope to follow");
}

#[test]
fn contradictions_and_unknown_names_are_refused() {
    for (text, wanted) in [
        (
            "parameters = [\"dampng\"]",
            "`parameters` names `dampng`, which the model does not have (did you mean `damping`?)",
        ),
        ("parameters = [\"g1/blnt\"]", "(did you mean `g1/blunt`?)"),
        ("parameters = [\"g7/*\"]", "`parameters` names `g7/*`"),
        ("fixed = [\"g3/magnus\"]", "`fixed` names `g3/magnus`"),
        ("tie = [[\"h*/blunt\"]]", "`tie` names `h*/blunt`"),
        (
            "[bounds]\nfluid = [0, 1]",
            "`bounds` names `fluid`, which the model does not have (did you mean `fluidcoef`?)",
        ),
        ("[prior]\n\"l3/mass\" = { mean = 1, std = 1 }", "`prior` names `l3/mass`"),
        (
            "parameters = [\"g1/blunt\"]\nfixed = [\"g1/*\"]",
            "`g1/blunt` stands under both `parameters` and `fixed`",
        ),
        (
            "fixed = [\"l1/mass\"]\n[prior]\n\"l1/mass\" = { mean = 1, std = 1 }",
            "`l1/mass` stands under both `prior` and `fixed`",
        ),
        ("parameters = [\"kutta\"]\ntie = [[\"*/blunt\"]]", "`tie` names `g1/blunt`, which is not fitted"),
        (
            "tie = [[\"*/blunt\"], [\"g1/blunt\", \"g2/blunt\"]]",
            "`g1/blunt` stands in more than one group of",
        ),
        (
            "tie = [[\"g1/blunt\", \"g1/kutta\"]]",
            "`tie` joins `g1/blunt` and `g1/kutta`, which are not of one kind",
        ),
        (
            "parameters = [\"*/frictionloss\"]\nproportional = [[\"*/frictionloss\"]]",
            "`proportional` keeps the ratios that the model has, and there `j1/frictionloss` is 0",
        ),
        ("[bounds]\nblunt = [2, 1]", "bounds of `blunt` are [2, 1]; the lower one must be less"),
        (
            "[bounds]\ndamping = [-1, 1]",
            "bounds of `j2/damping` reach down to -1; a damping is never below 0",
        ),
        (
            "[bounds]\nblunt = [0, 10]\n[prior]\n\"g1/blunt\" = { mean = 50, std = 1 }",
            "prior of `g1/blunt` has mean 50, outside its bounds [0, 10]",
        ),
    ] {
        let message = select(text).unwrap_err();
        assert!(message.contains(wanted), "{text}\n-> {message}\nwanted: {wanted}");
    }
}

#[test]
fn default_kinds_may_be_absent_from_a_model_but_stated_ones_may_not() {
    let dry = MODEL.replace("fluidshape=\"ellipsoid\"", "").replace("fluidcoef=\"0.7 0.2 1.6 0.9 12\"", "");
    let dry = Model::from_mjcf(&dry).unwrap();
    let select = |config: &FitConfig| Parameters::select(&dry, config);
    assert_eq!(select(&FitConfig::default()).unwrap().len(), 2);
    let stated = FitConfig { parameters: vec!["fluidcoef".into()], ..FitConfig::default() };
    assert!(matches!(select(&stated), Err(ParameterError::Unknown { table: "parameters", .. })));
}

#[test]
fn a_tied_prior_counts_whoever_carries_it() {
    let prior = Prior { mean: Finite::new(0.4).unwrap(), std: Positive::new(0.1).unwrap() };
    let text = "tie = [[\"*/blunt\"]]\n[prior]\n\"g2/blunt\" = { mean = 0.4, std = 0.1 }";
    let parameters = select(text).unwrap();
    let tied = &parameters.free[0];
    assert_eq!((tied.names.len(), tied.prior, tied.start), (2, Some(prior), 0.4));
}
