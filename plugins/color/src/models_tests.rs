use crate::histogram::{Histogram, bin};
use crate::mesh::ANY_LIGHT;
use crate::models::{Learned, Model, Models, Settings};
use rcs_msg::Stamp;

const SETTINGS: Settings = Settings {
    samples: 1000,
    max_models: 3,
    match_difference: 0.5,
    learning_period_ns: 1_000_000_000,
    memory: 4,
    fusion_frames: 3,
    min_sample_px: 10,
    known_least_cover: 0.25,
};
/// Images arrive five times a second.
const STEP_NS: u64 = 200_000_000;

/// A histogram of one colour with a share of another one.
fn mixed(red: u8, share: f32, other: u8) -> Histogram {
    let mut a = Histogram::default();
    a.add(red, 0);
    let mut b = Histogram::default();
    b.add(other, 0);
    let mut both = a.scaled(1000.0 * (1.0 - share)).counts().to_vec();
    std::iter::zip(&mut both, b.scaled(1000.0 * share).counts()).for_each(|(sum, count)| *sum += count);
    Histogram::from_counts(&both).unwrap()
}

fn plain(red: u8) -> Histogram {
    mixed(red, 0.0, red)
}

fn model(histogram: Histogram) -> Model {
    Model { name: String::new(), histogram, uses: 1, updated: Stamp(0), sample: None }
}

fn learn(models: &mut Models, histogram: &Histogram) -> Learned {
    models.learn_ground(histogram, || None, Stamp(1), STEP_NS, &SETTINGS)
}

#[test]
fn the_first_sample_becomes_a_model_at_once() {
    let mut models = Models::default();
    assert_eq!(learn(&mut models, &plain(10)), Learned::Added);
    assert_eq!(models.ground[0].histogram, plain(10));
}

#[test]
fn a_sample_close_to_a_model_updates_the_best_match_alone() {
    let mut models = Models::default();
    learn(&mut models, &plain(10));
    models.ground.push(Model {
        name: "other".to_owned(),
        histogram: plain(200),
        uses: 1,
        updated: Stamp(0),
        sample: None,
    });
    assert_eq!(learn(&mut models, &mixed(200, 0.25, 10)), Learned::Updated(1));
    assert_eq!(models.ground[0].histogram, plain(10));
    assert_eq!(models.ground[1].histogram, mixed(200, 0.125, 10));
}

#[test]
fn a_model_forgets_what_is_older_than_its_memory() {
    let mut models = Models::default();
    learn(&mut models, &plain(10));
    (0..50).for_each(|_| {
        learn(&mut models, &plain(10));
    });
    // Each new histogram has a weight of 1/4, so (3/4)^n of the old model remains.
    learn(&mut models, &mixed(10, 0.4, 90));
    assert!(models.ground[0].histogram.difference(&mixed(10, 0.1, 90)) < 1e-5);
}

#[test]
fn learning_mode_ends_a_period_after_the_most_different_sample_and_adds_that_one() {
    let mut models = Models::default();
    learn(&mut models, &plain(10));
    // Differences of 0.6, then 0.8, which restarts the period, then 0.7 until it ends.
    assert_eq!(learn(&mut models, &mixed(10, 0.6, 90)), Learned::Watches { left_ns: 1_000_000_000 });
    for _ in 0..3 {
        assert!(matches!(learn(&mut models, &mixed(10, 0.6, 90)), Learned::Watches { .. }));
    }
    assert_eq!(learn(&mut models, &mixed(10, 0.8, 120)), Learned::Watches { left_ns: 1_000_000_000 });
    for _ in 0..4 {
        assert!(matches!(learn(&mut models, &mixed(10, 0.7, 150)), Learned::Watches { .. }));
    }
    assert_eq!(learn(&mut models, &mixed(10, 0.7, 150)), Learned::Added);
    assert_eq!(models.ground.len(), 2);
    assert_eq!(models.ground[1].histogram, mixed(10, 0.8, 120), "the most different one, not the last");
    assert_eq!(models.learning_left_ns(), None);
}

#[test]
fn samples_that_match_update_models_in_learning_mode_too_and_time_goes_on() {
    let mut models = Models::default();
    learn(&mut models, &plain(10));
    learn(&mut models, &plain(90));
    for _ in 0..4 {
        assert_eq!(learn(&mut models, &plain(10)), Learned::Updated(0));
    }
    assert_eq!(learn(&mut models, &plain(10)), Learned::Added);
    assert_eq!(models.ground[1].histogram, plain(90));
}

#[test]
fn there_are_no_more_models_than_there_may_be() {
    let mut models = Models::default();
    for red in [10, 50, 90, 130, 170] {
        (0..8).for_each(|_| {
            learn(&mut models, &plain(red));
        });
    }
    assert_eq!(models.ground.len(), 3);
    assert_eq!(learn(&mut models, &plain(220)), Learned::Full);
    assert_eq!(learn(&mut models, &plain(50)), Learned::Updated(1));
}

#[test]
fn the_background_is_one_model_and_an_average() {
    let mut models = Models::default();
    models.learn_background(&plain(10), Stamp(1), &SETTINGS);
    models.learn_background(&plain(90), Stamp(2), &SETTINGS);
    let background = models.background.unwrap();
    assert_eq!(background.histogram, mixed(10, 0.5, 90));
    assert_eq!((background.uses, background.updated), (2, Stamp(2)));
}

#[test]
fn the_largest_probability_over_the_ground_models_counts_and_nothing_over_nothing_is_no_answer() {
    let models = Models {
        ground: vec![model(plain(10)), model(mixed(10, 0.75, 90))],
        background: Some(model(mixed(10, 0.5, 200))),
        obstacles: vec![model(mixed(90, 0.25, 250))],
        ..Models::default()
    };
    let p = models.probabilities();
    let at = |red: u8| p[bin(red, 0)];
    // Ground 1000 and 250 against background 500; ground 0 and 750 against the obstacle's 750; background alone.
    assert!((at(10) - 1000.0 / 1500.0).abs() < 1e-6 && (at(90) - 0.5).abs() < 1e-6);
    assert_eq!((at(200), at(250)), (0.0, 0.0));
    assert!(at(150).is_nan());
}

#[test]
fn models_to_begin_with_are_scaled_to_the_budget() {
    let model = |name: &str, sum: f32| Model {
        name: name.to_owned(),
        histogram: plain(10).scaled(sum),
        uses: 7,
        updated: Stamp(0),
        sample: None,
    };
    let file = Models {
        ground: vec![model("mulch", 3.0)],
        obstacles: vec![model("fence", 9e5)],
        ..Models::default()
    };
    let models = Models::default().with(&file, 1000);
    assert_eq!((models.ground[0].histogram.sum(), models.obstacles[0].histogram.sum()), (1000.0, 1000.0));
    assert_eq!((models.ground[0].name.as_str(), models.ground[0].uses), ("mulch", 7));
}

#[test]
fn with_another_budget_all_models_are_scaled_and_match_what_they_matched() {
    let mut models = Models { obstacles: vec![model(plain(250))], ..Models::default() };
    learn(&mut models, &plain(10));
    models.learn_background(&plain(200), Stamp(1), &SETTINGS);
    learn(&mut models, &plain(90));
    models.rescale(300);
    let all = models.ground.iter().chain(&models.background).chain(&models.obstacles);
    assert_eq!(all.map(|model| model.histogram.sum()).collect::<Vec<_>>(), [300.0; 3]);
    assert_eq!(models.best_match(&plain(10).scaled(300.0)), (0.0, Some(0)));
    // What learning mode has seen becomes a model of that budget, too.
    let settings = Settings { samples: 300, ..SETTINGS };
    while models.ground.len() < 2 {
        let other = mixed(10, 0.8, 120).scaled(300.0);
        models.learn_ground(&other, || None, Stamp(1), STEP_NS, &settings);
    }
    assert_eq!(models.ground[1].histogram, plain(90).scaled(300.0));
}

#[test]
fn blends_of_a_known_obstacle_and_the_ground_are_likely_whatever_the_background_is() {
    let model =
        |histogram| Model { name: String::new(), histogram, uses: 1, updated: Stamp(0), sample: None };
    let mut models = Models { ground: vec![model(plain(60))], ..Models::default() };
    assert!(models.blended_obstacles(0.25, &ANY_LIGHT).is_empty(), "no obstacle is known");
    models.obstacles.push(model(plain(220)));
    let likely = |models: &Models, red| models.blended_obstacles(0.25, &ANY_LIGHT)[bin(red, 0)];
    for (red, likelihood) in [(60, 0), (101, 255), (220, 255), (250, 0)] {
        assert_eq!(likely(&models, red), likelihood, "{red}");
    }
    models.background = Some(model(plain(101)));
    assert_eq!(likely(&models, 101), 255);
    // Other ground of that colour makes it less likely.
    models.ground.push(model(mixed(60, 0.2, 101)));
    assert!((1..128).contains(&likely(&models, 101)), "{}", likely(&models, 101));
}
