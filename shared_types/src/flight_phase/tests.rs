use super::FlightPhase::{Armed, Disarmed, Fly, Land, TakeOff};
use super::*;

impl FlightPhase {
    fn next(self, conditions: &Conditions) -> Self {
        self.transition(conditions).map_or(self, |row| row.to)
    }
}

/// Flight without any condition: no row of `TakeOff`, `Fly` and `Land` holds.
const CALM: Conditions = Conditions {
    armed: true,
    killed: false,
    arming_is_new: false,
    land: false,
    ready: true,
    spooled_up: false,
    airborne: true,
    arrived: false,
    overdue: false,
    touched_down: false,
    strayed: false,
    stranded: false,
    rests: false,
    found_flying: false,
};

/// Returns all sets of conditions.
fn every_condition() -> impl Iterator<Item = Conditions> {
    (0..1_u32 << 14).map(|bits| {
        let is = |place: u32| bits >> place & 1 == 1;
        Conditions {
            armed: is(0),
            killed: is(1),
            arming_is_new: is(2),
            land: is(3),
            ready: is(4),
            spooled_up: is(5),
            airborne: is(6),
            arrived: is(7),
            overdue: is(8),
            touched_down: is(9),
            found_flying: is(10),
            strayed: is(11),
            stranded: is(12),
            rests: is(13),
        }
    })
}

/// Asserts that all sets of conditions that pass, and no others, lead from one phase to the other.
fn leads_exactly_when(from: FlightPhase, to: FlightPhase, passes: impl Fn(&Conditions) -> bool) {
    for now in every_condition() {
        assert_eq!(
            from.next(&now) == to,
            passes(&now),
            "{from:?} → {to:?} with {now:?}"
        );
    }
}

fn flies_on(now: &Conditions) -> bool {
    now.armed && !now.killed
}

fn has_landed_blind(now: &Conditions) -> bool {
    now.airborne && now.rests
}

#[test]
fn it_arms_when_armed_again_with_all_ready_and_no_demand_to_land() {
    leads_exactly_when(Disarmed, Armed, |now| {
        flies_on(now) && now.arming_is_new && now.ready && !now.land && !now.found_flying
    });
}

#[test]
fn a_vehicle_found_in_the_air_is_led_to_the_path() {
    leads_exactly_when(Disarmed, TakeOff, |now| flies_on(now) && now.found_flying);
}

#[test]
fn armed_on_the_ground_it_disarms_when_it_is_to_land_or_no_longer_ready() {
    leads_exactly_when(Armed, Disarmed, |now| !flies_on(now) || now.land || !now.ready);
}

#[test]
fn it_takes_off_when_the_motors_have_idled() {
    leads_exactly_when(Armed, TakeOff, |now| {
        flies_on(now) && !now.land && now.ready && now.spooled_up
    });
}

#[test]
fn a_take_off_that_is_aborted_before_it_has_lifted_off_disarms() {
    leads_exactly_when(TakeOff, Disarmed, |now| {
        !flies_on(now) || has_landed_blind(now) || (now.land || now.overdue) && !now.airborne
    });
}

#[test]
fn a_take_off_that_is_aborted_in_the_air_lands() {
    leads_exactly_when(TakeOff, Land, |now| {
        flies_on(now) && (now.land || now.overdue || now.stranded) && now.airborne && !now.rests
    });
}

#[test]
fn it_flies_once_it_is_airborne_and_at_the_path() {
    leads_exactly_when(TakeOff, Fly, |now| {
        flies_on(now)
            && !now.land
            && !now.overdue
            && now.airborne
            && now.arrived
            && !now.strayed
            && !now.stranded
            && !now.rests
    });
}

#[test]
fn a_vehicle_that_is_seen_again_elsewhere_is_led_back_from_there() {
    leads_exactly_when(Fly, TakeOff, |now| {
        flies_on(now) && !now.land && now.airborne && now.strayed && !now.stranded && !now.rests
    });
    for (from, to) in [(TakeOff, TakeOff), (Fly, TakeOff), (Land, Land)] {
        let strayed = Conditions {
            strayed: true,
            ..CALM
        };
        let row = from.transition(&strayed).unwrap();
        assert_eq!((row.to, row.cause), (to, Cause::Strayed));
    }
}

#[test]
fn in_flight_only_a_stop_of_the_motors_disarms_or_a_landing_without_sight() {
    leads_exactly_when(Fly, Disarmed, |now| !flies_on(now) || has_landed_blind(now));
}

#[test]
fn in_flight_it_lands_on_demand() {
    leads_exactly_when(Fly, Land, |now| {
        flies_on(now) && (now.land || now.airborne && now.stranded) && !has_landed_blind(now)
    });
}

#[test]
fn on_its_way_down_it_disarms_on_the_ground() {
    leads_exactly_when(Land, Disarmed, |now| {
        !flies_on(now) || has_landed_blind(now) || now.touched_down && !(now.airborne && now.strayed)
    });
}

#[test]
fn nothing_else_leads_anywhere() {
    let ways = [
        (Disarmed, [Disarmed, Armed, TakeOff].as_slice()),
        (Armed, &[Armed, Disarmed, TakeOff]),
        (TakeOff, &[TakeOff, Disarmed, Land, Fly]),
        (Fly, &[Fly, Disarmed, Land, TakeOff]),
        (Land, &[Land, Disarmed]),
    ];
    for (from, reached) in ways {
        for now in every_condition() {
            assert!(reached.contains(&from.next(&now)), "{from:?} with {now:?}");
        }
    }
}

#[test]
fn every_row_is_the_first_that_holds_for_some_conditions() {
    for (place, row) in ROWS.iter().enumerate() {
        let earlier = || ROWS[..place].iter().filter(|other| other.from == row.from);
        let counts =
            every_condition().any(|now| (row.when)(&now) && !earlier().any(|other| (other.when)(&now)));
        assert!(counts, "{:?}: {}", row.from, row.words);
    }
}

#[test]
fn the_cause_of_a_transition_is_a_condition_that_holds_and_no_graver_one_does() {
    for phase in FlightPhase::ALL {
        for now in every_condition() {
            let Some(row) = phase.transition(&now) else {
                continue;
            };
            let expected = match row.to {
                Disarmed | Land if now.killed => Cause::Killed,
                Disarmed | Land if !now.armed => Cause::Disarmed,
                Disarmed if has_landed_blind(&now) && matches!(phase, TakeOff | Fly | Land) => {
                    Cause::TouchedDown
                }
                Land if phase == Land => Cause::Strayed,
                TakeOff if matches!(phase, TakeOff | Fly) => Cause::Strayed,
                Disarmed if phase == Armed && !now.ready => Cause::NotReady,
                Disarmed if phase == Land => Cause::TouchedDown,
                Disarmed | Land if now.land => Cause::LandingDemanded,
                Disarmed | Land if phase == TakeOff && now.overdue => Cause::Overdue,
                Disarmed | Land => Cause::Strayed,
                TakeOff if phase == Disarmed => Cause::FoundFlying,
                Armed | TakeOff | Fly => Cause::Progress,
            };
            assert_eq!(row.cause, expected, "from {phase:?} with {now:?}");
        }
    }
}

#[test]
fn the_table_of_the_documentation_is_this_table() {
    let page = include_str!("../../../docs/flight_phases.md");
    let rows = page.lines().filter_map(|line| {
        let cells: Vec<_> = line.split('|').map(str::trim).collect();
        let [_, from, words, to, cause, _] = cells[..] else {
            return None;
        };
        let phases = FlightPhase::ALL.map(FlightPhase::name);
        (phases.contains(&from) && phases.contains(&to)).then_some([from, words, to, cause])
    });
    let stated: Vec<_> = rows.collect();
    let ours = ROWS.map(|row| [row.from.name(), row.words, row.to.name(), row.cause.name()]);
    assert_eq!(stated, ours);
}

#[test]
fn a_calm_flight_stays_in_its_phase() {
    for phase in [TakeOff, Fly, Land] {
        assert_eq!(phase.next(&CALM), phase);
    }
}

#[test]
fn a_flight_passes_through_all_phases() {
    let moments = [
        (
            Conditions {
                arming_is_new: true,
                airborne: false,
                ..CALM
            },
            Armed,
        ),
        (
            Conditions {
                spooled_up: true,
                airborne: false,
                ..CALM
            },
            TakeOff,
        ),
        (
            Conditions {
                arrived: true,
                ..CALM
            },
            Fly,
        ),
        (Conditions { land: true, ..CALM }, Land),
        (
            Conditions {
                land: true,
                touched_down: true,
                ..CALM
            },
            Disarmed,
        ),
        // A used arming does not arm again.
        (
            Conditions {
                airborne: false,
                ..CALM
            },
            Disarmed,
        ),
    ];
    moments.iter().fold(Disarmed, |phase, (now, expected)| {
        assert_eq!(phase.next(now), *expected, "from {phase:?}");
        *expected
    });
}

#[test]
fn a_phase_returns_from_its_code_and_an_unknown_code_does_not_fly() {
    for phase in FlightPhase::ALL {
        assert_eq!(FlightPhase::from_code(phase.code()), phase);
    }
    assert_eq!(FlightPhase::from_code(77), Disarmed);
}
