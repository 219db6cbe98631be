use super::*;
use report::Tone;

fn fit() -> Fit {
    let blunt = FittedParameter {
        name: "g3/blunt".into(),
        unit: "1".into(),
        value: 0.5,
        std: 0.01,
        upper: 10.0,
        determined: true,
        ..FittedParameter::default()
    };
    Fit { parameters: vec![blunt], error_m: Some(1e-3), noise_m: 5e-4, ..Fit::default() }
}

pub(crate) fn cut_short(runs_dir: &Path, id: &str) -> std::path::PathBuf {
    let path = runs_dir.join(id);
    std::fs::create_dir(&path).unwrap();
    let start = serde_json::json!({
        "id": id, "kind": "driven", "model": file::MODEL_START, "prescribed": false, "version": "0.1.0",
        "clock": {"monotonic_ns": 5_000_000_000_u64, "utc": "2026-11-20T10:15:03Z"}, "config": "",
    });
    std::fs::write(path.join(file::START), start.to_string()).unwrap();
    path
}

#[test]
fn index_follows_the_folders_and_is_the_same_when_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let path = cut_short(folder.path(), "20261120T101503Z-ab12cd");
    std::fs::create_dir(folder.path().join("20261120T101504Z-ab12cd")).unwrap();
    let mut store = Store::open(folder.path()).unwrap();
    assert_eq!(store.refresh(false).unwrap(), Refreshed { runs: 2, read: 2, gone: 0 });
    let statuses: Vec<_> = store.runs(9).unwrap().into_iter().map(|run| run.status).collect();
    assert_eq!(statuses, ["incomplete", "unreadable"]);

    std::fs::write(path.join(file::FIT), fit().to_json().unwrap()).unwrap();
    std::fs::remove_dir(folder.path().join("20261120T101504Z-ab12cd")).unwrap();
    assert_eq!(store.refresh(false).unwrap(), Refreshed { runs: 1, read: 1, gone: 1 });
    let kept = store.runs(9).unwrap();
    assert_eq!((kept[0].fit_error_m, kept[0].error_over_noise), (Some(1e-3), Some(2.0)));
    assert_eq!((kept[0].determined, kept[0].headline.as_ref().unwrap().tone), (Some([1, 1]), Tone::Good));
    let trend = store.trend("g3/blunt").unwrap();
    assert_eq!((trend.len(), trend[0].value, trend[0].std), (1, 0.5, Some(0.01)));
    assert_eq!((trend[0].unit.as_str(), trend[0].lower, trend[0].upper), ("1", 0.0, 10.0));

    drop(store);
    std::fs::remove_file(folder.path().join(super::super::FILE)).unwrap();
    let mut store = Store::open(folder.path()).unwrap();
    store.refresh(true).unwrap();
    assert_eq!(store.runs(9).unwrap(), kept);
    assert_eq!(store.trend("g3/blunt").unwrap(), trend);
}

#[test]
fn whoever_looks_at_runs_waits_for_nobody_who_writes() {
    let folder = tempfile::tempdir().unwrap();
    cut_short(folder.path(), "20261120T101503Z-ab12cd");
    let mut store = Store::open(folder.path()).unwrap();
    store.refresh(false).unwrap();
    let writer = Connection::open(folder.path().join(super::super::FILE)).unwrap();
    writer.execute_batch("BEGIN IMMEDIATE").unwrap();
    let path = cut_short(folder.path(), "20261121T101503Z-ab12cd");
    std::fs::write(path.join(file::FIT), fit().to_json().unwrap()).unwrap();

    let began = std::time::Instant::now();
    let mut another = Store::open(folder.path()).unwrap();
    for store in [&mut store, &mut another] {
        // more than once, as a page asks
        for _ in 0..2 {
            assert_eq!(store.refresh(false).unwrap().runs, 2);
            assert_eq!(store.runs(9).unwrap().len(), 2);
            assert_eq!(store.trend("g3/blunt").unwrap().len(), 1);
        }
    }
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());

    writer.execute_batch("COMMIT").unwrap();
    store.refresh(false).unwrap();
    let indexed: u32 = writer.query_row("SELECT count(*) FROM runs", [], |row| row.get(0)).unwrap();
    assert_eq!(indexed, 2, "what could not be written then is written now");
    assert_eq!(store.runs(9).unwrap(), another.runs(9).unwrap());
}

#[test]
fn runs_are_listed_in_the_order_in_which_they_were_made() {
    let folder = tempfile::tempdir().unwrap();
    let made = ["20261120T101503Z-ab12cd", "19700101T000003Z-ab12cd", "20251120T101503Z-ab12cd"];
    for id in made {
        RunFolder::create(folder.path(), record::fixtures::start(id)).unwrap();
    }
    let mut store = Store::open(folder.path()).unwrap();
    store.refresh(false).unwrap();
    let ids = |runs: Vec<Summary>| runs.into_iter().map(|run| run.id).collect::<Vec<_>>();
    assert_eq!(ids(store.runs(9).unwrap()), made);
    assert_eq!(ids(store.runs(2).unwrap()), made[1..]);
    assert_eq!(ids(store.runs_before(Some(made[2]), 1).unwrap()), [made[1]]);
}

#[test]
fn run_whose_folder_has_not_changed_for_a_while_is_not_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = cut_short(folder.path(), "20261120T101503Z-ab12cd");
    let stop = serde_json::json!({
        "status": "success", "clock": {"monotonic_ns": 8_500_000_000_u64, "utc": "2026-11-20T10:15:06Z"},
        "servo": "acknowledged", "images": 350, "images_lost": 0, "messages_dropped": 0,
    });
    std::fs::write(path.join(file::STOP), stop.to_string()).unwrap();
    let an_hour_ago = SystemTime::now() - Duration::from_secs(3600);
    std::fs::File::open(&path).unwrap().set_modified(an_hour_ago).unwrap();
    let mut store = Store::open(folder.path()).unwrap();
    assert_eq!(store.refresh(false).unwrap().read, 1);
    assert_eq!(store.refresh(false).unwrap().read, 0);
    let run = &store.runs(1).unwrap()[0];
    assert_eq!((run.status.as_str(), run.duration_s, run.images), ("success", Some(3.5), Some(350)));
}
