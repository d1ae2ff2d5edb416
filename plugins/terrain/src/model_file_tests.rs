//! Conversion of models to a message and a file and back.

use super::*;
use crate::models::tests::{RULES, cell};
use proptest::prelude::*;
use rcs_msg::{AnyMessage, from_json, to_json};

proptest! {
    #[test]
    fn models_come_back_from_a_file_as_they_were(points in prop::collection::vec((0..0o77777_u16, 0..214_200_u32, any::<bool>()), 1..60), driven in 0..1000_u64) {
        let mut terrain = Terrain { driven, ..Terrain::default() };
        for (code, contrast, obstacle) in points {
            terrain.histograms.add(code, contrast);
            terrain.obstacle += u64::from(obstacle);
            terrain.ground += u64::from(!obstacle);
        }
        let model = Model { name: "learned 7".to_owned(), ..Model::new(terrain, 3) };
        let set = ModelSet { models: vec![model; 2], named: 0 };
        let weights = RULES.weights.normalised();
        let message = set.to_message(TerrainCamera::Both, 1.5, &weights);
        let text = to_json(&AnyMessage::new(message.clone())).unwrap();
        let read = models_of_text(&text).unwrap().unwrap();
        prop_assert_eq!(ModelSet::from_message(&read).unwrap(), set);
        let (span, read_weights) = matching_of(&read).unwrap();
        prop_assert_eq!((span, read_weights), (1.5, weights.normalised()));
    }
}

#[test]
fn files_that_are_not_models_are_refused_with_the_reason() {
    let set = ModelSet { models: vec![Model::new(cell(0, 10, 0), 1)], named: 0 };
    let good = set.to_message(TerrainCamera::Left, 1.0, &RULES.weights);
    let refusal = |change: &dyn Fn(&mut TerrainModels)| {
        let mut message = good.clone();
        change(&mut message);
        let text = to_json(&AnyMessage::new(message)).unwrap();
        models_of_text(&text).unwrap_err().to_string()
    };
    let cases = [
        (refusal(&|m| m.models[0].texture.truncate(5)), "model 0 has 5 bins of texture, expected 8"),
        (refusal(&|m| m.models[0].red_blue[3] += 1), "11 points in its histogram of red_blue, expected 10"),
        (refusal(&|m| m.models[0].driven = u64::MAX), "expected at most"),
        (refusal(&|m| m.ratio_span_octaves = 0.0), "span of the ratios' bins is 0"),
        (
            refusal(&|m| m.weights = Some(TerrainWeights { texture: -1.0, ..Default::default() })),
            "weight is -1",
        ),
    ];
    for (got, expected) in cases {
        assert!(got.contains(expected), "got {got:?}, expected {expected:?}");
    }
    assert!(models_of_text("{").is_err());
    assert_eq!(models_of_text("  ").unwrap(), None);
    assert!(from_json::<TerrainModels>("{\"modles\": []}").is_err());
}
