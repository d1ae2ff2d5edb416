//! Each function against values that `reference.py` computes with `numpy` and `scipy`.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use rcs_formula::{Formula, Moments, Points};
use rcs_msg::Stamp;
use serde_json::Value;

fn points(value: &Value) -> Points {
    let stamps: Vec<Stamp> =
        value["t"].as_array().unwrap().iter().map(|t| Stamp(t.as_u64().unwrap())).collect();
    let values: Vec<f64> =
        value["v"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect();
    Points::new(stamps, values)
}

fn check(what: &str, got: &Points, wanted: &Points, scale: f64) {
    assert_eq!(got.stamps, wanted.stamps, "{what}: times");
    for (i, (got, wanted)) in got.values.iter().zip(wanted.values.iter()).enumerate() {
        let near = (got - wanted).abs() <= 1e-9 * (1.0 + wanted.abs()) * scale;
        assert!(near || (got.is_nan() && wanted.is_nan()), "{what} [{i}]: {got}, expected {wanted}");
    }
}

fn cases() -> Vec<Value> {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reference.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap().as_array().unwrap().clone()
}

#[test]
fn every_function_gives_the_reference_values_on_random_and_awkward_data() {
    for case in cases() {
        let (a, b) = (points(&case["a"]), case["b"].get("t").map(|_| points(&case["b"])));
        // NumPy's own slopes lose digits where neighbours are nanoseconds apart, or values have a large offset.
        let scale = if case["name"] == "large offset" { 1e4 } else { 10.0 };
        for (text, wanted) in case["results"].as_object().unwrap() {
            let formula: Formula = text.parse().unwrap();
            let fields: Vec<Points> = formula
                .fields()
                .iter()
                .map(|field| if field.topic == "/a" { a.clone() } else { b.clone().unwrap() })
                .collect();
            let got = formula.eval(&fields).unwrap();
            check(&format!("{}: {text}", case["name"]), &got, &points(wanted), scale);
        }
    }
}

#[test]
fn statistics_are_the_reference_values_however_the_points_are_grouped() {
    for case in cases() {
        let a = points(&case["a"]);
        let wanted = &case["statistics"];
        let of: Vec<Moments> =
            a.stamps.iter().zip(a.values.iter()).map(|(&t, &v)| Moments::of(t, v)).collect();
        for group in [1, 3, 8, 40] {
            let parts = of.chunks(group).map(|part| part.iter().copied().reduce(Moments::join).unwrap());
            let Some(all) = parts.reduce(Moments::join) else {
                assert_eq!(wanted["points"], 0);
                continue;
            };
            assert_eq!(
                (wanted["points"].as_u64(), wanted["finite"].as_u64()),
                (Some(all.points as u64), Some(all.finite as u64))
            );
            let near = |got: Option<f64>, name: &str| match (got, wanted[name].as_f64()) {
                (Some(got), Some(wanted)) => (got - wanted).abs() <= 1e-9 * (1.0 + wanted.abs()),
                (got, wanted) => got.is_none() && wanted.is_none(),
            };
            let known = |value: f64| (all.finite > 0).then_some(value);
            let all_near = near(known(all.min), "min")
                && near(known(all.max), "max")
                && near(all.mean(), "mean")
                && near(all.deviation(), "deviation")
                && near(Some(all.integral), "integral");
            assert!(all_near, "{}: {all:?}, expected {wanted}", case["name"]);
        }
    }
}
