use proptest::prelude::*;

use super::*;

const RANGES: [Source; 5] =
    [Source::STEREO, Source::COLOR, Source::TERRAIN, Source::CLASSIFIER, Source::INFRARED];

fn said(costs: [u8; 6], confidences: [u8; 6]) -> Vec<(Source, u8, u8)> {
    (0..6).map(|i| (Source::BUNDLED[i], costs[i], confidences[i])).collect()
}

fn fuse_six(costs: [u8; 6], confidences: [u8; 6], weights: &Weights) -> Fused {
    fuse(&said(costs, confidences), weights)
}

fn place(source: Source) -> usize {
    Source::BUNDLED.iter().position(|&other| other == source).unwrap()
}

/// Reference: the rule step by step from its definition, over lists.
fn reference_fuse(costs: [u8; 6], confs: [u8; 6], weights: &Weights) -> (Option<f64>, Option<Source>) {
    let bumper = place(Source::BUMPER);
    if confs[bumper] != 0 && costs[bumper] >= OBSTACLE_COST && costs[bumper] != 255 && costs[bumper] <= 250 {
        return (Some(f64::from(costs[bumper])), Some(Source::BUMPER));
    }
    let weight = |source: Source| f64::from(weights.get(source).weight);
    let present: Vec<Source> = RANGES
        .into_iter()
        .filter(|&s| confs[place(s)] != 0 && costs[place(s)] <= 250 && weight(s) > 0.0)
        .collect();
    let total: f64 = present.iter().map(|&s| weight(s)).sum();
    let cost = present.iter().map(|&s| weight(s) / total * f64::from(costs[place(s)])).sum();
    let mut by_confidence = present.clone();
    by_confidence.sort_by_key(|&s| std::cmp::Reverse(confs[place(s)])); // stable: the first wins a tie
    (by_confidence.first().map(|_| cost), by_confidence.first().copied())
}

fn weights() -> impl Strategy<Value = Weights> {
    prop::array::uniform5(prop_oneof![Just(0.0_f32), 0.0..2.0_f32, Just(1.0)]).prop_map(|values| {
        let entries = RANGES.into_iter().zip(values);
        entries.fold(Weights::default(), |weights, (source, weight)| weights.with(source, weight))
    })
}

fn confidences() -> impl Strategy<Value = [u8; 6]> {
    prop::array::uniform6(prop_oneof![2 => Just(0_u8), 3 => any::<u8>()])
}

proptest! {
    #[test]
    fn fusion_equals_the_reference(costs: [u8; 6], confs in confidences(), weights in weights()) {
        let fused = fuse_six(costs, confs, &weights);
        let (cost, source) = reference_fuse(costs, confs, &weights);
        prop_assert_eq!(fused.source, source);
        if let Some(cost) = cost {
            prop_assert!((f64::from(fused.cost) - cost).abs() <= 0.5 + 1e-9, "{fused:?} {cost}");
        } else {
            prop_assert_eq!(fused, Fused::UNKNOWN);
        }
        if let Some(source) = source {
            prop_assert_eq!(fused.confidence, confs[place(source)]);
            prop_assert_eq!(fused.label, Label::of_cost(costs[place(source)]));
        }
    }

    #[test]
    fn only_the_ratios_of_weights_matter(costs: [u8; 6], confs in confidences(), weights in weights()) {
        let double = weights.iter().map(|entry| Weighted { weight: entry.weight * 2.0, ..entry }).collect();
        prop_assert_eq!(fuse_six(costs, confs, &weights), fuse_six(costs, confs, &double));
    }

    #[test]
    fn one_source_alone_gives_its_own_cost(cost in 0..=MAX_COST, conf in 1..=255_u8, weight in 0.01..10.0_f32) {
        let fused = fuse(&[(Source::TERRAIN, cost, conf)], &Weights::default().with(Source::TERRAIN, weight));
        prop_assert_eq!((fused.cost, fused.source, fused.confidence), (cost, Some(Source::TERRAIN), conf));
    }

    #[test]
    fn the_order_in_which_sources_are_given_does_not_matter(costs: [u8; 6], confs in confidences(), weights in weights(), turn in 0..6_usize) {
        let mut turned = said(costs, confs);
        turned.rotate_left(turn);
        prop_assert_eq!(fuse(&turned, &weights), fuse_six(costs, confs, &weights));
    }
}

#[test]
fn nothing_seen_is_unknown_and_not_free() {
    assert_eq!(fuse(&[], &Weights::default()), Fused::UNKNOWN);
    assert_eq!(fuse_six([0; 6], [0; 6], &Weights::default()), Fused::UNKNOWN);
    assert_eq!(fuse_six([UNKNOWN_COST; 6], [255; 6], &Weights::default()), Fused::UNKNOWN);
    let none = Weights::default().iter().map(|entry| Weighted { weight: 0.0, ..entry }).collect();
    assert_eq!(fuse_six([0; 6], [9; 6], &none), Fused::UNKNOWN);
}

#[test]
fn a_bumper_hit_overrides_and_a_bumper_that_is_free_does_not() {
    let (mut costs, mut confs, bumper) = ([10; 6], [200; 6], place(Source::BUMPER));
    (costs[bumper], confs[bumper]) = (250, 1);
    let fused = fuse_six(costs, confs, &Weights::default());
    assert_eq!((fused.cost, fused.source), (250, Some(Source::BUMPER)));
    costs[bumper] = 0;
    assert_eq!(fuse_six(costs, confs, &Weights::default()).cost, 10);
    confs = [0; 6];
    confs[bumper] = 255;
    assert_eq!(fuse_six(costs, confs, &Weights::default()), Fused::UNKNOWN);
}

#[test]
fn a_source_that_nobody_knew_of_counts_like_any_other() {
    let radar = Source::new("radar").unwrap();
    let said = [(Source::STEREO, 100, 50), (radar, 200, 60)];
    assert_eq!(fuse(&said, &Weights::default()).cost, 150);
    let fused = fuse(&said, &Weights::default().with(radar, 3.0));
    assert_eq!((fused.cost, fused.source), (175, Some(radar)));
    let overriding: Weights =
        [Weighted { source: radar, weight: 1.0, kind: SourceKind::Override }].into_iter().collect();
    assert_eq!(fuse(&said, &overriding).cost, 200);
}

#[test]
fn weights_that_cannot_be_are_refused_by_name_and_count_as_none() {
    let bad = Weights::default().with(Source::COLOR, f32::NAN);
    assert_eq!(
        bad.check().unwrap_err().to_string(),
        "weight of color is NaN, expected a finite number from 0 up"
    );
    assert!(Weights::default().with(Source::STEREO, -1.0).check().is_err());
    assert!(Weights::default().check().is_ok());
    assert_eq!(fuse_six([80; 6], [5; 6], &bad.with(Source::COLOR, f32::INFINITY)).cost, 80);
}
