//! `rig campaign`: runs, fits, diagnoses and designs by itself until what was asked is known.

use rustix::process::Signal;
use system_tests::campaign::{Hidden, Tank};
use system_tests::daemon::Bench;
use system_tests::{Background, in_real_time, json, printed, run_rig, wait_until};

#[test]
fn campaign_resolves_a_late_servo_without_a_hand_though_it_is_killed_on_the_way() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = Hidden::Delay(0.025);
    let tank = Tank::new(folder.path(), Some(hidden), 1);
    let campaign = Background::start(tank.campaign(&["--resolve", "--max-runs", "4"]));
    wait_until("the first run", 120.0, || tank.out().join("campaign.json").exists());
    campaign.signal(Signal::KILL);
    drop(campaign);
    let first = tank.record()["runs"][0]["run"].clone();

    let output = tank.campaign(&["--resolve", "--max-runs", "4"]).output().expect("rig campaign");
    assert!(output.status.success(), "{}", printed(&output));
    let record = tank.record();
    assert_eq!((&record["state"], &record["runs"][0]["run"]), (&"reached".into(), &first), "{record}");
    let runs = record["runs"].as_array().expect("runs").len();
    assert!((2..=4).contains(&runs), "one run leaves it open, and four are enough: {record}");
    assert!(tank.names(hidden), "{:?} {record}", tank.named());
    let needs = record["needs"].to_string();
    assert!(needs.contains("lamp"), "no film tells a late servo from a late camera, a lamp does: {needs}");

    let other = tank.campaign(&["--goal", "q2/damping 5%"]).output().expect("rig campaign");
    assert_eq!(other.status.code(), Some(2), "{}", printed(&other));
    assert!(printed(&other).contains("another campaign"), "{}", printed(&other));
}

#[test]
fn campaign_for_a_precision_ends_where_a_cause_bends_the_number_and_says_what_to_fit() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = Hidden::Lag(0.03);
    let tank = Tank::new(folder.path(), Some(hidden), 2);
    let output =
        tank.campaign(&["--goal", "q2/damping 1e-9", "--max-runs", "4"]).output().expect("rig campaign");
    assert_eq!(output.status.code(), Some(4), "{}", printed(&output));
    let record = tank.record();
    assert_eq!(record["state"], "needs-a-hand", "{record}");
    assert_eq!(record["runs"].as_array().expect("runs").len(), 2, "{record}");
    let needs = record["needs"].to_string();
    assert!(needs.contains("servo_lag/time") && needs.contains("[fit] parameters"), "{record}");
}

#[test]
fn campaign_for_a_precision_beside_a_daemon_is_its_job_and_stops_where_its_runs_are_spent() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    let _daemon = bench.start(&[]);
    let campaign = |goal: &str| {
        let config = bench.config.to_str().expect("readable");
        let runs = bench.runs.to_str().expect("readable");
        run_rig(["--json", "campaign", config, "--goal", goal, "--max-runs", "1", "--runs-dir", runs])
    };
    let output = campaign("q2/damping 1e-15");
    assert_eq!(output.status.code(), Some(4), "{}", printed(&output));
    assert!(printed(&output).contains("as job 1"), "{}", printed(&output));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one object");
    assert_eq!(said["verdict"], "budget-spent", "{said}");
    let record = json(&std::path::Path::new(said["out"].as_str().expect("a folder")).join("campaign.json"));
    let known = &record["steps"][0]["known"][0];
    assert!(known["std"].as_f64() > known["wanted_std"].as_f64(), "{record}");
    assert!(record["says"].to_string().contains("q2/damping"), "{record}");

    let unknown = campaign("g9/blunt 5%");
    assert_eq!(unknown.status.code(), Some(2), "{}", printed(&unknown));
    assert!(printed(&unknown).contains("no fitted parameter is called `g9/blunt`"), "{}", printed(&unknown));
}
