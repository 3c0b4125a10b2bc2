#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use proptest::prelude::*;

use super::*;
use crate::row::Cell;

proptest! {
    #[test]
    fn shards_have_every_sample_once(samples in 0..5000u64, count in 1..40u64) {
        let shards = (0..count).map(|index| Shard { index, count }.samples(samples));
        let all: Vec<u64> = shards.flatten().collect();
        prop_assert!(all.iter().copied().eq(0..samples));
    }
}

fn header(rows: u64) -> Header {
    Header {
        rows,
        form: FORM,
        shard: Shard { index: 3, count: 20 },
        sweep: "s".to_owned(),
        program: "p".to_owned(),
        files: BTreeMap::new(),
        sweep_text: String::new(),
        scenario_path: PathBuf::new(),
        scenario_text: String::new(),
        columns: vec!["sample".to_owned(), "rmse".to_owned(), "law".to_owned()],
    }
}

fn row(sample: u64) -> Row {
    #[expect(clippy::cast_precision_loss, reason = "a small number")]
    let number = 0.1 * sample as f64;
    vec![
        Cell::Integer(sample),
        Cell::Number(Some(number)),
        Cell::Text("a".to_owned()),
    ]
}

fn written(folder: &Path, rows: Range<u64>, total: u64) -> Journal {
    let mut writer = open(folder, &header(total)).unwrap();
    assert_eq!(writer.results, rows.start);
    for sample in rows {
        writer.write(&row(sample)).unwrap();
    }
    writer
}

#[test]
fn a_shard_goes_on_after_its_last_whole_row_and_has_the_bytes_of_one_that_was_never_stopped() {
    let (whole, broken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = written(whole.path(), 0..10, 10).complete().unwrap();
    written(broken.path(), 0..6, 10).pause().unwrap();
    let partial = header(10).shard.partial_path(broken.path());
    let bytes = std::fs::read(&partial).unwrap();
    let end_of_row_3 = bytes
        .iter()
        .enumerate()
        .filter(|(_, byte)| **byte == b'\n')
        .nth(4)
        .unwrap()
        .0;
    // Killed within the fifth row.
    for cut in [end_of_row_3 + 1, end_of_row_3 + 2, end_of_row_3 + 9] {
        std::fs::write(&partial, &bytes[..cut]).unwrap();
        let resumed = written(broken.path(), 4..10, 10).complete().unwrap();
        assert_eq!(std::fs::read(resumed).unwrap(), std::fs::read(&path).unwrap());
    }
}

#[test]
fn rows_are_read_as_they_were_written_and_damage_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), 0..5, 5).complete().unwrap();
    let mut reader = ShardReader::open(&path).unwrap();
    for sample in 0..5 {
        assert_eq!(reader.next_row().unwrap(), Some(row(sample)));
    }
    assert_eq!(reader.next_row().unwrap(), None);
    let good = std::fs::read_to_string(&path).unwrap();
    for bad in [
        good.replacen("0.2", "0.3", 1),
        good[..good.len() - 80].to_owned(),
        format!("{good}\0"),
    ] {
        std::fs::write(&path, bad).unwrap();
        let mut reader = ShardReader::open(&path).unwrap();
        let end = (0..6).find_map(|_| reader.next_row().err());
        assert!(matches!(end, Some(JournalError::Damaged { .. })), "{end:?}");
    }
}

#[test]
fn a_shard_of_another_sweep_or_program_and_one_in_use_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let writer = written(folder.path(), 0..2, 2);
    assert!(matches!(
        open(folder.path(), &header(2)),
        Err(JournalError::Locked { .. })
    ));
    writer.pause().unwrap();
    for other in [
        Header {
            sweep: "other".to_owned(),
            ..header(2)
        },
        Header {
            program: "other".to_owned(),
            ..header(2)
        },
        Header {
            files: BTreeMap::from([("the plug-in".to_owned(), "other".to_owned())]),
            ..header(2)
        },
    ] {
        let refused = open(folder.path(), &other);
        assert!(
            matches!(refused, Err(JournalError::Foreign { .. })),
            "{refused:?}"
        );
    }
}

#[test]
fn a_complete_shard_is_compared_with_what_would_be_flown() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), 0..2, 2).complete().unwrap();
    check_complete(folder.path(), &header(2)).unwrap();
    let other = Header {
        scenario_text: "other".to_owned(),
        ..header(2)
    };
    let refused = check_complete(folder.path(), &other).unwrap_err().to_string();
    assert!(refused.contains("it is of another scenario"), "{refused}");
    let other = Shard { index: 4, count: 20 };
    std::fs::rename(path, other.path(folder.path())).unwrap();
    let expected = Header {
        shard: other,
        ..header(2)
    };
    let refused = check_complete(folder.path(), &expected).unwrap_err().to_string();
    assert!(
        refused.contains("its name does not match the shard that it holds"),
        "{refused}"
    );
}

#[test]
fn a_missing_folder_of_shards_is_trouble_and_no_result_that_cannot_be_written() {
    let error = SweepError::from(shards_in(Path::new("nosuch")).unwrap_err());
    assert!(matches!(error, SweepError::Trouble(_)), "{error}");
    assert!(error.to_string().contains("nosuch"), "{error}");
}
