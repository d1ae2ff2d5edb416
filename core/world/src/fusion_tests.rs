use proptest::prelude::*;

use super::*;

/// Evidence without backing.
fn plain(cost: u8, confidence: u8) -> Evidence {
    Evidence { cost, confidence, ..Evidence::NONE }
}

fn said(costs: [u8; 6], confidences: [u8; 6], backings: [u8; 6]) -> Vec<(Source, Evidence)> {
    let evidence = |i: usize| Evidence { backing: backings[i], ..plain(costs[i], confidences[i]) };
    (0..6).map(|i| (Source::BUNDLED[i], evidence(i))).collect()
}

fn fuse_six(costs: [u8; 6], confidences: [u8; 6], weights: &Weights) -> Fused {
    fuse(&said(costs, confidences, [0; 6]), weights)
}

fn place(source: Source) -> usize {
    Source::BUNDLED.iter().position(|&other| other == source).unwrap()
}

/// Reference: the rules step by step from their definition, over lists; the exact cost.
fn reference_fuse(said: &[(Source, Evidence)], weights: &Weights) -> Option<f64> {
    let weight = |source: Source| f64::from(weights.get(source).weight);
    let of = |kind: SourceKind| {
        let present = said.iter().filter(move |(source, evidence)| {
            let counts = weight(*source) > 0.0;
            weights.get(*source).kind == kind && evidence.confidence > 0 && evidence.cost <= 250 && counts
        });
        present.copied().collect::<Vec<_>>()
    };
    if let Some(touch) = of(SourceKind::Override).iter().map(|(_, evidence)| evidence.cost).max() {
        let distant = || weights.iter().filter(|entry| entry.kind != SourceKind::Override);
        let is_blind = distant().count() > 0 && distant().all(|entry| entry.weight <= 0.0);
        return (!is_blind || touch >= OBSTACLE_COST).then(|| f64::from(touch));
    }
    let evidence = |(source, said): &(Source, Evidence)| weight(*source) * f64::from(said.confidence);
    let ranges = of(SourceKind::Range);
    let highest = ranges.iter().map(|(_, said)| said.cost).max();
    let seen: f64 = ranges.iter().map(&evidence).sum();
    let learned = of(SourceKind::Learned);
    let backing = |(_, said): &(Source, Evidence)| f64::from(said.backing) / 255.0;
    let backed = learned.iter().map(backing).fold(0.0, f64::max);
    let is_lower = |entry: &(Source, Evidence)| highest.is_some_and(|highest| entry.1.cost < highest);
    let said_part = |entry: &(Source, Evidence)| if is_lower(entry) { backing(entry) } else { 1.0 };
    let factor =
        |entry: &(Source, Evidence)| backing(entry).max(if is_lower(entry) { 0.0 } else { 1.0 - backed });
    let said: f64 = learned.iter().map(|entry| evidence(entry) * said_part(entry)).sum();
    if seen + said < f64::from(weights.least_evidence) {
        return None;
    }
    let total: f64 = learned.iter().map(|entry| evidence(entry) * factor(entry)).sum();
    let sum: f64 = learned.iter().map(|e| evidence(e) * factor(e) * f64::from(e.1.cost)).sum();
    let rest = seen * (1.0 - backed);
    let all = total + rest;
    (all > 1e-6).then(|| (sum + rest * f64::from(highest.unwrap_or(0))) / all)
}

fn weights() -> impl Strategy<Value = Weights> {
    prop::array::uniform6(prop_oneof![Just(0.0_f32), 0.01..2.0_f32, Just(1.0)]).prop_map(|values| {
        let entries = Source::BUNDLED.into_iter().zip(values);
        entries.fold(Weights::default(), |weights, (source, weight)| weights.with(source, weight))
    })
}

fn confidences() -> impl Strategy<Value = [u8; 6]> {
    prop::array::uniform6(prop_oneof![2 => Just(0_u8), 3 => any::<u8>()])
}

proptest! {
    #[test]
    fn fusion_equals_the_reference(costs: [u8; 6], confs in confidences(), backings in confidences(), weights in weights()) {
        let said = said(costs, confs, backings);
        let fused = fuse(&said, &weights);
        if let Some(cost) = reference_fuse(&said, &weights) {
            prop_assert!((f64::from(fused.cost) - cost).abs() <= 0.51, "{fused:?} {cost}");
        } else {
            prop_assert_eq!(fused, Fused::UNKNOWN);
        }
        prop_assert_eq!(fused.label, Label::of_cost(fused.cost), "one rule for the label");
        if let Some(source) = fused.source {
            prop_assert_eq!(fused.confidence, confs[place(source)]);
            prop_assert_eq!(Label::of_cost(costs[place(source)]), fused.label);
        }
    }

    #[test]
    fn one_source_alone_gives_its_own_cost(cost in 0..=MAX_COST, conf in 4..=255_u8) {
        let fused = fuse(&[(Source::TERRAIN, plain(cost, conf))], &Weights::default());
        prop_assert_eq!((fused.cost, fused.source, fused.confidence), (cost, Some(Source::TERRAIN), conf));
    }

    #[test]
    fn the_order_in_which_sources_are_given_does_not_matter(costs: [u8; 6], confs in confidences(), backings in confidences(), weights in weights(), turn in 0..6_usize) {
        let straight = said(costs, confs, backings);
        let mut turned = straight.clone();
        turned.rotate_left(turn);
        prop_assert_eq!(fuse(&turned, &weights), fuse(&straight, &weights));
    }
}

#[test]
fn nothing_seen_is_unknown_and_not_free() {
    assert_eq!(fuse(&[], &Weights::default()), Fused::UNKNOWN);
    assert_eq!(fuse_six([0; 6], [0; 6], &Weights::default()), Fused::UNKNOWN);
    assert_eq!(fuse_six([UNKNOWN_COST; 6], [255; 6], &Weights::default()), Fused::UNKNOWN);
    let none: Weights = Weights::default()
        .iter()
        .filter(|entry| entry.kind != SourceKind::Override)
        .map(|entry| Weighted { weight: 0.0, ..entry })
        .collect();
    let but_bumper: Vec<_> =
        said([0; 6], [9; 6], [0; 6]).into_iter().filter(|(source, _)| *source != Source::BUMPER).collect();
    assert_eq!(fuse(&but_bumper, &none), Fused::UNKNOWN);
}

#[test]
fn little_evidence_is_unknown() {
    let known = |conf: u8, weight: f32| {
        let weights = Weights::default().with(Source::COLOR, weight);
        fuse(&[(Source::COLOR, plain(250, conf))], &weights).label
    };
    assert_eq!([known(3, 1.0), known(4, 1.0)], [Label::Unknown, Label::Obstacle]);
    assert_eq!([known(15, 0.2), known(25, 0.2)], [Label::Unknown, Label::Obstacle]);
}

#[test]
fn a_touch_comes_first_then_what_was_driven_over_then_the_rest() {
    let bumper = place(Source::BUMPER);
    let check = |bumper_cost: u8, bumper_conf: u8, expected: (u8, Source)| {
        let (mut costs, mut confs) = ([240; 6], [200; 6]);
        (costs[bumper], confs[bumper]) = (bumper_cost, bumper_conf);
        let fused = fuse_six(costs, confs, &Weights::default());
        assert_eq!((fused.cost, fused.source), (expected.0, Some(expected.1)));
    };
    check(250, 1, (250, Source::BUMPER));
    check(0, 1, (0, Source::BUMPER));
    check(0, 0, (240, Source::STEREO));
}

#[test]
fn without_a_sensor_that_looks_ahead_what_was_driven_over_is_unknown_and_what_was_hit_stays() {
    let blind: Weights = Weights::default()
        .iter()
        .map(|entry| Weighted { weight: f32::from(u8::from(entry.kind == SourceKind::Override)), ..entry })
        .collect();
    assert!(blind.is_blind() && !Weights::default().is_blind());
    let touched = |cost: u8| [(Source::STEREO, plain(0, 80)), (Source::BUMPER, plain(cost, 200))];
    assert_eq!(fuse(&touched(0), &blind), Fused::UNKNOWN);
    assert_eq!(fuse(&touched(250), &blind).cost, 250);
    let looks = blind.clone().with(Source::STEREO, 0.01);
    assert_eq!((fuse(&touched(0), &looks).cost, looks.is_blind()), (0, false));
    let off = blind.with(Source::BUMPER, 0.0);
    assert_eq!(fuse(&touched(250), &off), Fused::UNKNOWN, "a touch of weight 0 is off, too");
    // A map of touches alone is no map of a vehicle that has lost its eyes.
    let touches: Weights =
        Weights::default().iter().filter(|entry| entry.kind == SourceKind::Override).collect();
    assert!(!touches.is_blind());
}

#[test]
fn range_sensors_do_not_average_each_other_away() {
    // The infrared sensor sees the fence through which stereo sees the grass.
    let fence = [(Source::STEREO, plain(0, 80)), (Source::INFRARED, plain(250, 40))];
    assert_eq!(fuse(&fence, &Weights::default().with(Source::INFRARED, 0.3)).cost, 250);
}

#[test]
fn what_was_learned_lowers_geometry_only_as_far_as_experience_backs_it() {
    let check = |backing: u8, low: u8, high: u8| {
        let learned = Evidence { backing, ..plain(20, 80) };
        let fused =
            fuse(&[(Source::STEREO, plain(250, 200)), (Source::TERRAIN, learned)], &Weights::default());
        assert!((low..=high).contains(&fused.cost), "backing {backing}: {fused:?}");
    };
    check(0, 250, 250);
    check(255, 20, 20);
    check(128, 150, 220);
    // Another learned source, of growth in which nobody has driven, does not count against experience.
    let terrain = Evidence { backing: 255, ..plain(20, 40) };
    let said =
        [(Source::STEREO, plain(250, 30)), (Source::COLOR, plain(240, 80)), (Source::TERRAIN, terrain)];
    assert_eq!(fuse(&said, &Weights::default()).cost, 20);
    // It raises a cost without backing, by its weight and confidence alone.
    let said = [(Source::STEREO, plain(0, 80)), (Source::COLOR, plain(250, 80))];
    assert_eq!(fuse(&said, &Weights::default()).cost, 125);
    assert_eq!(fuse(&said, &Weights::default().with(Source::COLOR, 0.25)).cost, 50);
}

#[test]
fn a_source_that_nobody_knew_of_is_a_range_sensor_of_weight_one() {
    let radar = Source::new("radar").unwrap();
    let said = [(Source::STEREO, plain(100, 50)), (radar, plain(200, 60))];
    assert_eq!(fuse(&said, &Weights::default()).cost, 200);
    let learned: Weights =
        [Weighted { source: radar, weight: 0.5, kind: SourceKind::Learned }].into_iter().collect();
    let fused = fuse(&said, &learned);
    assert_eq!((fused.cost, fused.source), (138, Some(radar)), "(100·50 + 200·30) / 80");
}

#[test]
fn weights_that_cannot_be_count_as_none() {
    let mut confs = [15; 6];
    confs[place(Source::BUMPER)] = 0;
    let mut costs = [80; 6];
    costs[place(Source::COLOR)] = 240;
    for weight in [f32::NAN, f32::INFINITY, -1.0] {
        assert_eq!(fuse_six(costs, confs, &Weights::default().with(Source::COLOR, weight)).cost, 80);
    }
    // Sums that are infinite are no cost: not that of free ground.
    let huge = Weights::default().with(Source::COLOR, 1e37);
    assert_eq!(fuse_six(costs, confs, &huge), Fused::UNKNOWN);
}
