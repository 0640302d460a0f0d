//! The posture database as a file: records come back unchanged, and bad files are refused.

use std::fs;

use crate::common::{joints, postures};
use eigenhand_synergy::{MotionRecord, PostureDatabase, PostureRecord, Source, SynergyError, Unit};
use proptest::prelude::*;
use tempfile::TempDir;

fn records(n: usize, n_joints: usize) -> Vec<PostureRecord> {
    postures(n, n_joints)
        .into_iter()
        .enumerate()
        .map(|(i, posture)| PostureRecord {
            posture,
            object: ["cube", "it's; DROP TABLE posture"][i % 2].to_owned(),
            // Out of order on purpose: the order of insertion is not that of the episodes.
            episode: (i as u64 * 7) % 10,
            lambda: 1.0 / 3.0,
            seed: u64::MAX - i as u64,
            goal: [0.1, -0.2, 1.0 / 7.0],
            step: i as u32,
            source: [Source::Policy, Source::Noise, Source::Script][i % 3],
        })
        .collect()
}

#[test]
fn records_come_back_in_order() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("postures.sqlite");
    let (joints, records) = (joints(12), records(10, 12));
    let mut database = PostureDatabase::open(&path, &joints, &[]).unwrap();
    assert!(database.is_empty().unwrap());
    database.insert_all(&records[..4]).unwrap();
    database.insert_all(&records[4..]).unwrap();
    drop(database);
    for database in
        [PostureDatabase::open(&path, &joints, &[]).unwrap(), PostureDatabase::open_existing(&path).unwrap()]
    {
        assert_eq!(database.len().unwrap(), 10);
        assert_eq!(database.joints(), joints);
        assert_eq!(database.load().unwrap(), records);
        let of_the_policy = records.iter().filter(|record| record.source != Source::Script);
        let postures: Vec<Vec<f64>> = of_the_policy.map(|record| record.posture.clone()).collect();
        assert_eq!(database.policy_postures().unwrap(), postures);
    }
}

#[test]
fn other_programs_find_a_column_for_each_joint() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("postures.sqlite");
    let records = records(3, 5);
    PostureDatabase::open(&path, &joints(5), &[]).unwrap().insert_all(&records).unwrap();
    let plain = rusqlite::Connection::open(&path).unwrap();
    for (i, column) in
        ["\"FFJ3\"", "\"ffj3#2\"", "\"it's \"\"quoted\"\"\"", "\"指/0\"", "\"a.b[c]\\d\""].into_iter().enumerate()
    {
        let sql = format!("SELECT posture.{column} FROM posture WHERE step = 1 AND object LIKE 'it''s%'");
        let value: f64 = plain.query_row(&sql, [], |row| row.get(0)).unwrap();
        assert_eq!(value, records[1].posture[i], "{column}");
    }
    let mode: String = plain.query_row("PRAGMA journal_mode", [], |row| row.get(0)).unwrap();
    assert_eq!(mode, "wal");
}

#[test]
fn a_finished_database_is_one_file_and_goes_on_in_wal_mode() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("p");
    let mode = || -> String {
        rusqlite::Connection::open(&path).unwrap().query_row("PRAGMA journal_mode", [], |row| row.get(0)).unwrap()
    };
    let mut database = PostureDatabase::open(&path, &joints(3), &[]).unwrap();
    database.insert_all(&records(4, 3)).unwrap();
    {
        // While another program reads, the mode stays.
        let reader = PostureDatabase::open_existing(&path).unwrap();
        database.finish().unwrap();
        assert_eq!(reader.len().unwrap(), 4);
    }
    database.finish().unwrap();
    assert_eq!(mode(), "delete");
    drop(database);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    assert_eq!(PostureDatabase::open_existing(&path).unwrap().len().unwrap(), 4);
    drop(PostureDatabase::open(&path, &joints(3), &[]).unwrap());
    assert_eq!(mode(), "wal");
}

#[test]
fn truncation_deletes_later_episodes_only() {
    let dir = TempDir::new().unwrap();
    let records = records(10, 3);
    let mut database = PostureDatabase::open(dir.path().join("p"), &joints(3), &[]).unwrap();
    database.insert_all(&records).unwrap();
    assert_eq!(database.truncate_from_episode(u64::MAX).unwrap(), 0);
    assert_eq!(database.truncate_from_episode(6).unwrap(), 4);
    let mut kept: Vec<PostureRecord> = records.iter().filter(|record| record.episode < 6).cloned().collect();
    assert_eq!(database.load().unwrap(), kept);
    database.insert_all(&records[9..]).unwrap();
    kept.push(records[9].clone());
    assert_eq!(database.load().unwrap(), kept);
}

#[test]
fn motions_come_back_in_order_and_are_truncated_with_their_episodes() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("postures.sqlite");
    let (joints, actuators) = (joints(3), joints(2));
    let motion = |i: u64| MotionRecord {
        episode: i / 4,
        object: "cube".to_owned(),
        step: i as u32,
        held: i % 4 > 1,
        posture: vec![0.1 * i as f64, -1.0 / 3.0, 2.0],
        command: vec![i as f64 / 7.0, -0.5],
    };
    let motions: Vec<MotionRecord> = (0..12).map(motion).collect();
    let mut database = PostureDatabase::open(&path, &joints, &actuators).unwrap();
    database.insert_motions(&motions).unwrap();
    let mut bad = motions[..3].to_vec();
    bad[1].command.pop();
    database.insert_motions(&bad).unwrap_err();
    assert_eq!(PostureDatabase::open_existing(&path).unwrap().motions().unwrap(), motions);
    database.truncate_from_episode(1).unwrap();
    assert_eq!(database.motions().unwrap(), motions[..4]);

    let plain = rusqlite::Connection::open(&path).unwrap();
    let sql = "SELECT \"ctrl:ffj3#2\" FROM motion WHERE held = 1 AND \"FFJ3\" > 0.25";
    assert_eq!(plain.query_row(sql, [], |row| row.get::<_, f64>(0)).unwrap(), -0.5);
    drop(plain);
    let message = PostureDatabase::open(&path, &joints, &joints).unwrap_err().to_string();
    assert!(message.contains("2 joints"), "{message}");
}

#[test]
fn a_bad_record_keeps_the_whole_batch_out() {
    let dir = TempDir::new().unwrap();
    let mut database = PostureDatabase::open(dir.path().join("p"), &joints(3), &[]).unwrap();
    let spoil: [fn(&mut PostureRecord); 5] = [
        |record| record.posture[1] = f64::NAN,
        |record| record.posture.push(0.0),
        |record| record.lambda = f64::INFINITY,
        |record| record.goal[2] = f64::NAN,
        |record| record.episode = u64::MAX,
    ];
    for spoil in spoil {
        let mut batch = records(4, 3);
        spoil(&mut batch[2]);
        database.insert_all(&batch).unwrap_err();
        assert_eq!(database.len().unwrap(), 0);
    }
}

#[test]
fn other_joints_are_refused() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("p");
    PostureDatabase::open(&path, &joints(3), &[]).unwrap();
    let mut renamed = joints(3);
    renamed[2].name = "stranger".to_owned();
    let mut swapped = joints(3);
    swapped.swap(0, 1);
    let mut metres = joints(3);
    metres[0].unit = Unit::Metre;
    for other in [renamed, swapped, metres, joints(2), joints(4)] {
        let message = PostureDatabase::open(&path, &other, &[]).unwrap_err().to_string();
        assert!(message.contains("expected") && message.contains("got 3 joints: \"FFJ3\" [rad]"), "{message}");
        assert!(message.contains(path.to_str().unwrap()), "{message}");
    }
    let mut wider = joints(3);
    wider[0].upper += 1.0;
    assert_eq!(PostureDatabase::open(&path, &wider, &[]).unwrap().joints(), joints(3));
}

fn source(error: &SynergyError) -> &SynergyError {
    match error {
        SynergyError::InFile { source, .. } => source,
        error => error,
    }
}

#[test]
fn other_files_are_refused_and_left_alone() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("file");
    let missing = PostureDatabase::open_existing(&path).unwrap_err();
    assert!(matches!(missing, SynergyError::Io { .. }), "{missing}");
    assert!(!path.exists());

    fs::write(&path, "").unwrap();
    let empty = PostureDatabase::open_existing(&path).unwrap_err();
    assert!(matches!(source(&empty), SynergyError::NotADatabase { .. }), "{empty}");

    let text = "episode,object\n".repeat(500);
    fs::write(&path, &text).unwrap();
    for error in
        [PostureDatabase::open(&path, &joints(3), &[]).unwrap_err(), PostureDatabase::open_existing(&path).unwrap_err()]
    {
        assert!(matches!(source(&error), SynergyError::NotADatabase { .. }), "{error}");
        assert!(error.to_string().contains(path.to_str().unwrap()), "{error}");
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), text);

    fs::remove_file(&path).unwrap();
    let foreign = rusqlite::Connection::open(&path).unwrap();
    foreign.execute_batch("CREATE TABLE bookmarks (url TEXT)").unwrap();
    drop(foreign);
    let before = fs::read(&path).unwrap();
    let error = PostureDatabase::open(&path, &joints(3), &[]).unwrap_err();
    assert!(error.to_string().contains("another program"), "{error}");
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn another_schema_is_refused() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("p");
    PostureDatabase::open(&path, &joints(3), &[]).unwrap();
    rusqlite::Connection::open(&path).unwrap().pragma_update(None, "user_version", 9).unwrap();
    let error = PostureDatabase::open(&path, &joints(3), &[]).unwrap_err();
    assert!(matches!(source(&error), SynergyError::Schema { got: 9, .. }), "{error}");
}

#[test]
fn a_damaged_file_is_refused() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("p");
    PostureDatabase::open(&path, &joints(20), &[]).unwrap().insert_all(&records(2000, 20)).unwrap();
    let whole = fs::read(&path).unwrap();
    let mut garbled = whole.clone();
    garbled[8192..whole.len() / 2].fill(0x5a);
    for bytes in [&whole[..whole.len() / 3], &garbled] {
        fs::write(&path, bytes).unwrap();
        let error = PostureDatabase::open_existing(&path).unwrap_err();
        assert!(matches!(source(&error), SynergyError::Damaged { .. }), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_joint_names_and_values(
        names in prop::collection::hash_set(".{1,12}", 1..8),
        value in prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL,
    ) {
        let mut joints = joints(names.len());
        for (joint, name) in joints.iter_mut().zip(names) {
            joint.name = name;
        }
        let dir = TempDir::new().unwrap();
        let mut record = records(1, joints.len());
        record[0].posture[0] = value;
        PostureDatabase::open(dir.path().join("p"), &joints, &[]).unwrap().insert_all(&record).unwrap();
        let database = PostureDatabase::open(dir.path().join("p"), &joints, &[]).unwrap();
        prop_assert_eq!(database.joints(), joints);
        prop_assert_eq!(database.load().unwrap(), record);
    }
}
