use super::*;
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_rate_agrees_with_counting(period in 1..30u64, phase in 0..30u64, tick in 0..500u64) {
        let rate = Rate { period, phase };
        let ticks: Vec<u64> = (0..500).map(|n| phase + n * period).collect();
        prop_assert_eq!(rate.occurs_at(tick), ticks.contains(&tick));
        prop_assert_eq!(rate.last_at_or_before(tick), ticks.iter().copied().rfind(|&at| at <= tick));
        prop_assert_eq!(rate.count_before(tick), ticks.iter().filter(|&&at| at < tick).count() as u64);
    }

    #[test]
    fn in_an_order_no_service_waits_for_a_later_one(latencies in proptest::array::uniform5(proptest::array::uniform7(0..2u64))) {
        if let Ok(order) = topological_order(&latencies) {
            let place = |service| order.iter().position(|&other| other == service).unwrap();
            for service in ServiceId::ALL {
                for (input, latency) in service.inputs().iter().zip(latencies[service.index()]) {
                    if latency == 0 {
                        prop_assert!(place(input.topic.publisher().unwrap()) < place(service));
                    }
                }
            }
        }
    }
}

#[test]
fn the_ideal_order_is_the_ring() {
    assert_eq!(Schedule::ideal(1_000_000, 10).order(), &ServiceId::ALL);
}

#[test]
fn a_cycle_without_delay_is_named() {
    let mut latencies = default_latencies();
    latencies[ServiceId::Plant.index()][0] = 0;
    let every = Rate::EVERY_TICK;
    let error = Schedule::new(1, 10, [every; SERVICES], [every; TOPICS], latencies).unwrap_err();
    let ScheduleError::CycleWithoutDelay(cycle) = &error else {
        panic!("{error}")
    };
    assert_eq!(cycle.first(), cycle.last());
    assert!(error.to_string().contains("plant → estimator → "), "{error}");
}

#[test]
fn a_flight_without_telemetry_lacks_that_topic_and_nothing_else() {
    let with = Schedule::ideal(1, 100).with_telemetry();
    let without = Schedule::ideal(1, 100);
    let topics: Vec<_> = without
        .published_topics()
        .chain([Topic::ControlTelemetry])
        .collect();
    assert!(with.published_topics().eq(topics));
    assert_eq!(without.sample_count(Topic::ControlTelemetry), 0);
    let sensors = Schedule::ideal(1, 100).with_telemetry().with_sensors();
    assert!(sensors.published_topics().eq(with.published_topics().chain([
        Topic::ImuSample,
        Topic::GnssFix,
        Topic::BaroAltitude,
        Topic::MagField,
        Topic::NavigationInnovations,
    ])));
    assert_eq!(without.run_ahead_ticks() + 5, sensors.run_ahead_ticks());
    let poses = sensors.clone().with_navigation(true);
    assert!(
        poses
            .published_topics()
            .eq(sensors.published_topics().chain([Topic::PoseInnovations]))
    );
    let antennas = sensors.clone().with_navigation(false).with_baseline();
    assert!(
        antennas.published_topics().eq(poses
            .published_topics()
            .chain([Topic::GnssBaseline, Topic::BaselineInnovations]))
    );
    let blind = sensors.with_navigation(false);
    assert_eq!(
        (
            blind.sample_count(Topic::MocapPose),
            poses.sample_count(Topic::MocapPose)
        ),
        (0, 101)
    );
    for service in ServiceId::ALL {
        // Hosts go by the position of an output.
        let outputs = without.outputs(service).map(|output| output.topic);
        assert!(
            outputs.eq(with
                .outputs(service)
                .map(|output| output.topic)
                .take(without.outputs(service).count()))
        );
    }
}

#[test]
fn a_real_plant_differs_from_a_simulated_one_only_by_the_truth() {
    let simulated = Schedule::ideal(1, 100)
        .with_telemetry()
        .with_sensors()
        .with_navigation(true)
        .with_baseline();
    let real = simulated.clone().with_real_world();
    assert!(simulated.simulates_the_world() && !real.simulates_the_world());
    for topic in Topic::ALL {
        let is_known = topic != Topic::VehicleTruth;
        let count = if is_known {
            simulated.sample_count(topic)
        } else {
            0
        };
        assert_eq!(real.sample_count(topic), count, "{topic}");
        assert_eq!(real.publication(topic).is_due(50), is_known, "{topic}");
        assert_eq!(real.buffer_size(topic), simulated.buffer_size(topic));
    }
    assert_eq!(
        real.publications(Topic::VehicleTruth)
            .last_at_or_before(u64::MAX - 1),
        None
    );
}

#[test]
fn a_topic_is_due_only_when_its_publisher_steps() {
    let mut services = [Rate::EVERY_TICK; SERVICES];
    services[ServiceId::Plant.index()] = Rate { period: 2, phase: 0 };
    let error = Schedule::new(1, 10, services, [Rate::EVERY_TICK; TOPICS], default_latencies()).unwrap_err();
    assert!(
        matches!(
            error,
            ScheduleError::TopicWithoutStep {
                publisher: ServiceId::Plant,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn a_join_of_unequal_ticks_is_refused() {
    let mut services = [Rate::EVERY_TICK; SERVICES];
    let mut topics = [Rate::EVERY_TICK; TOPICS];
    services[ServiceId::PathGenerator.index()].period = 2;
    topics[Topic::PathReference.index()].period = 2;
    let error = Schedule::new(1, 100, services, topics, default_latencies()).unwrap_err();
    assert_eq!(error, ScheduleError::UnequalJoin { tick: 1 });
}

#[test]
fn a_due_sample_is_the_newest_one_delivered() {
    let mut topics = [Rate::EVERY_TICK; TOPICS];
    topics[Topic::MocapPose.index()] = Rate { period: 10, phase: 0 };
    let mut latencies = default_latencies();
    latencies[ServiceId::Estimator.index()][0] = 5;
    let schedule = Schedule::new(1, 100, [Rate::EVERY_TICK; SERVICES], topics, latencies).unwrap();
    let due = |tick| schedule.edge(ServiceId::Estimator, 0).due_sample(tick);
    assert_eq!(
        [due(4), due(5), due(14), due(15), due(25)],
        [None, Some(0), Some(0), Some(10), Some(20)]
    );
    assert_eq!(schedule.sample_count(Topic::MocapPose), 11);
    let fresh = |tick| {
        schedule
            .edge(ServiceId::Estimator, 0)
            .is_fresh(tick, due(tick).unwrap())
    };
    assert_eq!(
        [fresh(5), fresh(6), fresh(14), fresh(15), fresh(16)],
        [true, false, false, true, false]
    );
}
