//! Tests of the table of modes.

use super::*;

const TABLE: &str = r#"
format = 1

[[mode]]
name = "REVERSE"
priority = 5
enter = [{ signal = "bumper", at_least = 1.0 }]
exit = [{ signal = "moved_m", at_least = 0.5 }, { signal = "mode_s", at_least = 4.0 }]
action = "REVERSE"
pause_s = 1.0

[[mode]]
name = "SLOW"
priority = 1
enter = [{ signal = "room_m", at_most = 0.4, for_s = 0.5 }]
exit = [{ signal = "room_m", at_least = 0.6, for_s = 1.0 }]
max_speed_mps = 0.5
"#;

fn at(ms: u64) -> Stamp {
    Stamp(ms * 1_000_000)
}

fn with(values: &[(Signal, f64)]) -> Signals {
    let mut signals = [0.0; Signal::COUNT];
    signals[Signal::RoomM as usize] = 9.0;
    for &(signal, value) in values {
        signals[signal as usize] = value;
    }
    signals
}

fn to(transition: Option<Transition>) -> Option<String> {
    transition.map(|transition| transition.to)
}

#[test]
fn a_mode_begins_when_all_conditions_have_held_long_enough_and_ends_with_a_reason() {
    let (table, mut modes) = (Table::parse(TABLE).unwrap(), Modes::default());
    let narrow = with(&[(Signal::RoomM, 0.3)]);
    assert_eq!(modes.step(&table, &narrow, at(0)), None);
    assert_eq!(modes.step(&table, &with(&[]), at(400)), None);
    assert_eq!(modes.step(&table, &narrow, at(450)), None, "it counts from anew");
    let begun = modes.step(&table, &narrow, at(950)).unwrap();
    assert_eq!((begun.from.as_str(), begun.to.as_str()), ("", "SLOW"));
    assert_eq!(begun.reason, "room_m is 0.30, at most 0.4");
    assert_eq!(modes.step(&table, &with(&[]), at(1000)), None);
    let ended = modes.step(&table, &with(&[]), at(2000)).unwrap();
    assert_eq!((ended.from.as_str(), ended.to.as_str()), ("SLOW", ""));
    assert_eq!(ended.reason, "room_m is 9.00, at least 0.6");
}

#[test]
fn a_higher_priority_interrupts_and_a_pause_is_kept() {
    let (table, mut modes) = (Table::parse(TABLE).unwrap(), Modes::default());
    let narrow = with(&[(Signal::RoomM, 0.3)]);
    modes.step(&table, &narrow, at(0));
    assert_eq!(to(modes.step(&table, &narrow, at(500))), Some("SLOW".to_owned()));
    let hit = with(&[(Signal::Bumper, 1.0), (Signal::RoomM, 0.3)]);
    assert_eq!(to(modes.step(&table, &hit, at(600))), Some("REVERSE".to_owned()));
    assert_eq!(modes.step(&table, &hit, at(650)), None, "a lower priority does not interrupt");
    let away = with(&[(Signal::Bumper, 1.0), (Signal::MovedM, 0.6)]);
    assert_eq!(to(modes.step(&table, &away, at(700))), Some(String::new()));
    assert_eq!(modes.step(&table, &hit, at(1600)), None, "not before its pause is over");
    assert_eq!(to(modes.step(&table, &hit, at(1700))), Some("REVERSE".to_owned()));
    assert_eq!(modes.begun(), 3);
}

#[test]
fn what_happens_during_a_mode_does_not_begin_the_next_one() {
    let (table, mut modes) = (Table::parse(TABLE).unwrap(), Modes::default());
    let hit = with(&[(Signal::Bumper, 1.0), (Signal::RoomM, 0.3)]);
    assert_eq!(to(modes.step(&table, &hit, at(0))), Some("REVERSE".to_owned()));
    let away = with(&[(Signal::MovedM, 0.6), (Signal::RoomM, 0.3)]);
    assert_eq!(to(modes.step(&table, &away, at(900))), Some(String::new()));
    let narrow = with(&[(Signal::RoomM, 0.3)]);
    assert_eq!(
        modes.step(&table, &narrow, at(950)),
        None,
        "it was narrow for 0.9 s, nearly all of that in the mode"
    );
    assert_eq!(modes.step(&table, &narrow, at(1400)), None);
    assert_eq!(to(modes.step(&table, &narrow, at(1450))), Some("SLOW".to_owned()));
}

#[test]
fn tables_that_cannot_work_are_refused() {
    let row = |keys: &str| format!("format = 1\n[[mode]]\nname = 'A'\npriority = 1\n{keys}");
    let enter = "enter = [{ signal = 'slip', at_least = 0.5 }]\n";
    let exit = "exit = [{ signal = 'mode_s', at_least = 3.0 }]\n";
    for (text, expected) in [
        ("mode = 3".to_owned(), "line 1, "),
        ("format = 2".to_owned(), "format is 2, expected 1"),
        (row(enter), "line 2, "),
        (row(&format!("{enter}exit = []")), "mode \"A\": expected at least one condition"),
        (row(&format!("{enter}exit = [{{ signal = 'slip' }}]")), "mode \"A\": slip: expected either"),
        (row(&format!("{enter}exit = [{{ signal = 'slip', at_most = nan }}]")), "mode \"A\": slip: expected"),
        (
            row(&format!("{enter}exit = [{{ signal = 'mode_s', at_least = 1.0, for_s = nan }}]")),
            "mode \"A\": mode_s: for_s is NaN, expected 0 to 600",
        ),
        (row(&format!("{enter}exit = [{{ signal = 'luck', at_most = 1.0 }}]")), "line 6, "),
        (row(&format!("{enter}{exit}max_speed_mps = -1.0")), "mode \"A\": expected speeds"),
        (row(&format!("{enter}{exit}pause_s = nan")), "mode \"A\": pause_s is NaN, expected 0 to 600"),
        (row(&format!("{enter}{exit}bars_m = -0.0001")), "mode \"A\": bars_m is -0.0001, expected 0 to 600"),
        (row(&format!("{enter}{exit}arcs_per_side = 0")), "mode \"A\": arcs_per_side"),
        (row(&format!("{enter}{exit}speed = 1.0")), "line 7, "),
        (
            format!(
                "{}\n{}",
                row(&format!("{enter}{exit}")),
                row(&format!("{enter}{exit}")).replace("format = 1\n", "")
            ),
            "mode \"A\": expected a name of its own",
        ),
    ] {
        let error = Table::parse(&text).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{text}: {error}");
    }
}

#[test]
fn a_bound_of_the_room_that_the_signal_does_not_exceed_is_refused() {
    let table = Table::parse(TABLE).unwrap();
    assert_eq!(table.check_room(0.61), Ok(()));
    for (most_m, bound) in [(0.6, "0.6 m"), (0.5, "0.6 m"), (0.4, "0.4 m")] {
        let refused = table.check_room(most_m).unwrap_err().to_string();
        let expected = format!("mode \"SLOW\": room_m: the bound is {bound}, expected less than");
        assert!(refused.starts_with(&expected), "{refused}");
    }
}

#[test]
fn another_table_with_as_many_modes_begins_anew() {
    let (table, mut modes) = (Table::parse(TABLE).unwrap(), Modes::default());
    assert!(modes.step(&table, &with(&[(Signal::Bumper, 1.0)]), at(0)).is_some());
    // The first mode of the other table has more conditions.
    let more = "{ signal = \"bumper\", at_least = 1.0 }, { signal = \"slip\", at_least = 0.5 }, \
                { signal = \"room_m\", at_most = 0.4 }, { signal = \"mode_s\", at_least = 0.0 }";
    let other = TABLE.replacen("{ signal = \"bumper\", at_least = 1.0 }", more, 1);
    let other = Table::parse(&other).unwrap();
    assert_eq!(modes.step(&other, &with(&[(Signal::Bumper, 1.0)]), at(50)), None);
    assert_eq!(modes.active(), None);
    let all = with(&[(Signal::Bumper, 1.0), (Signal::Slip, 0.6), (Signal::RoomM, 0.3)]);
    assert_eq!(to(modes.step(&other, &all, at(100))).as_deref(), Some("REVERSE"));
}

#[test]
fn of_the_bundled_modes_those_of_slip_alone_bar_a_place_for_the_next_run() {
    let table = Table::parse(include_str!("../../../assets/modes/lagr.toml")).unwrap();
    let of_slip = table.modes.iter().filter(|mode| mode.is_of_slip() && mode.bars_m > 0.0);
    assert_eq!(of_slip.map(|mode| &*mode.name).collect::<Vec<_>>(), ["SLIPPING", "SPINNING", "SPINNING_ON"]);
}
