//! Texts of formulas: what they mean, and what is said about a wrong one.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use proptest::prelude::*;
use rcs_formula::{FieldRef, Formula, Points};
use std::sync::Arc;

/// The value of a formula at one time where `/a.x` is 2, `/b.y[3]` is 5, and `/s.state` is the state `ERROR`.
fn value(text: &str) -> Result<f64, String> {
    let formula: Formula = text.parse().map_err(|error| format!("{error}"))?;
    let points = |field: &FieldRef| match field.to_string().as_str() {
        "/a.x" => Points::from_seconds(&[(1.0, 2.0)]),
        "/b.y[3]" => Points::from_seconds(&[(1.0, 5.0)]),
        "/s.state" => {
            let names = [(1, "EXEC".into()), (3, "ERROR".into())];
            Points { names: Arc::new(names.into()), ..Points::from_seconds(&[(1.0, 3.0)]) }
        }
        other => panic!("{other}"),
    };
    let fields: Vec<Points> = formula.fields().iter().map(points).collect();
    let points = formula.eval(&fields).map_err(|error| error.to_string())?;
    Ok(points.values[0])
}

#[test]
fn operators_have_their_usual_order() {
    for (text, wanted) in [
        ("/a.x + /b.y[3] * 2", 12.0),
        ("(/a.x + /b.y[3]) * 2", 14.0),
        ("/b.y[3]/ /a.x", 2.5),
        ("/b.y[3] /2 - 1e-1", 2.4),
        ("-/a.x ^ 2", 4.0),
        ("2 ^ 3 * 2", 16.0),
        ("7 - 4 - /a.x", 1.0),
        ("/b.y[3] % 3", 2.0),
        ("/a.x > 1 && /b.y[3] < 4", 0.0),
        ("/a.x > 1 || /b.y[3] < 4", 1.0),
        ("!(/a.x > 1)", 0.0),
        ("maximum(/a.x, minimum(/b.y[3], 4))", 4.0),
        ("maximum(minimum(/a.x, 1), minimum(/b.y[3], 4)) + 1", 5.0),
        ("absolute(minimum(-/a.x, /b.y[3]))", 2.0),
        ("/s.state == ERROR", 1.0),
        ("/s.state != \"EXEC\"", 1.0),
        ("/s.state == 3", 1.0),
        ("/s.state == DONE", 0.0),
        ("degrees(pi)", 180.0),
        ("{/a}.x", 2.0),
    ] {
        assert_eq!(value(text), Ok(wanted), "{text}");
    }
}

#[test]
fn no_comparison_is_true_at_a_gap() {
    let at_gap = |text: &str| {
        let formula: Formula = text.parse().unwrap();
        let points = |field: &FieldRef| match field.topic.as_str() {
            // Both are known at 1 s and missing at 2 s.
            "/s" => {
                let names = [(1, "EXEC".into()), (3, "ERROR".into())];
                let points = Points::from_seconds(&[(1.0, 1.0), (2.0, f64::NAN)]);
                Points { names: Arc::new(names.into()), ..points }
            }
            "/a" => Points::from_seconds(&[(1.0, 1.0), (2.0, f64::NAN)]),
            _ => Points::from_seconds(&[(1.0, 1.0), (2.0, 1.0)]),
        };
        let fields: Vec<Points> = formula.fields().iter().map(points).collect();
        formula.eval(&fields).unwrap().values.to_vec()
    };
    for (text, before) in [
        ("/s.state != ERROR", 1.0),
        ("/s.state != DONE", 1.0),
        ("/s.state != 3", 1.0),
        ("/s.state == EXEC", 1.0),
        ("/a.x != 3", 1.0),
        ("/a.x != /b.x", 0.0),
        ("/b.x != /a.x", 0.0),
        ("/a.x && /b.x", 1.0),
        ("/a.x || /a.x", 1.0),
    ] {
        assert_eq!(at_gap(text), [before, 0.0], "{text}");
    }
    assert_eq!(at_gap("/a.x || /b.x"), [1.0, 1.0], "the other side is true");
}

#[test]
fn a_wrong_text_is_refused_and_says_where() {
    for (text, part) in [
        ("", "expected a field"),
        ("/a.x + ", "formula"),
        ("(/a.x", "formula"),
        ("/a.x /b.y[3] /", "formula"),
        ("/a.x 3", "column 6: expected an operator"),
        ("smoth(/a.x)", "got \"smoth\", expected one of smooth"),
        ("/a.x & /a.x", "formula"),
        ("/a.x, 2", "outside of a function"),
        ("minimum(/a.x, 2, 3)", "at most two values"),
        ("/a.x # 2", "column 6: got '#'"),
        ("/.x", "expected a topic and a field"),
        ("/a.[", "column"),
        ("smooth(3)", "a function over time needs a field"),
        ("/a.x + ERROR", "is a name"),
        ("/a.x == ERROR", "expected states"),
        ("smooth(/a.x, -1)", "the width of a window"),
    ] {
        let error = value(text).unwrap_err();
        assert!(error.contains(part), "{text}: {error}");
    }
}

#[test]
fn a_mistake_in_operators_parentheses_or_calls_is_told_with_its_column() {
    for (text, said) in [
        ("/fix.latitude + * 2", "17: got \"*\", expected a value"),
        ("/fix.latitude +", "16: expected a value"),
        ("(/fix.latitude", "1: '(' without ')' after it"),
        ("/fix.latitude)", "14: got ')' without '(' before it"),
        ("2 + sine(/fix.latitude, 2)", "5: expected sine(a)"),
        ("minimum(/fix.latitude)", "1: expected minimum(a, b)"),
        ("2 smooth(/fix.latitude)", "3: expected an operator between two values"),
        ("(/fix.latitude) (2)", "17: expected an operator between two values"),
        ("2 + ()", "6: got ')', expected a value"),
        ("minimum(, 2)", "9: got ',', expected a value"),
        ("2 ! 3", "3: got \"!\", expected an operator"),
        ("2 & 3", "3: got \"&\", expected an operator"),
    ] {
        let error = text.parse::<Formula>().unwrap_err().to_string();
        assert_eq!(error, format!("formula, column {said}: {text:?}"));
    }
}

#[test]
fn a_name_that_an_enum_does_not_have_is_refused_and_a_state_that_no_message_has_had_is_not() {
    let value = |text: &str| {
        let formula: Formula = text.parse().unwrap();
        let points = Points {
            names: Arc::new([(1, "EXEC".into())].into()),
            states: ["EXEC", "ERROR"].map(str::to_owned).into(),
            ..Points::from_seconds(&[(1.0, 1.0)])
        };
        formula.eval(&[points]).map(|points| points.values[0]).map_err(|error| error.to_string())
    };
    assert_eq!(value("/s.state == EXEC"), Ok(1.0));
    assert_eq!(value("/s.state == ERROR"), Ok(0.0));
    assert_eq!(value("/s.state != ERROR"), Ok(1.0));
    for text in ["/s.state == REACHED", "/s.state != REACHED"] {
        let error = value(text).unwrap_err();
        assert!(error.contains("no state \"REACHED\", expected one of EXEC, ERROR"), "{text}: {error}");
    }
}

#[test]
fn a_field_of_any_name_is_itself_again() {
    for (topic, path) in [
        ("/wm1/status", ".cycle"),
        ("/wm1/map", ".data.@length"),
        ("/a-b/c d", ".x[3].y"),
        ("odd", ".x"),
        ("/with.dot", ".x"),
        ("/a", "[\"a name with.dots\"]"),
        ("/a", ".odd-name"),
    ] {
        let field = FieldRef { topic: topic.into(), path: path.parse().unwrap() };
        let formula: Formula = field.to_string().parse().unwrap_or_else(|error| panic!("{field}: {error}"));
        assert_eq!(formula.fields(), std::slice::from_ref(&field), "{field}");
        assert_eq!(formula.as_field(), Some(&field));
    }
}

proptest! {
    #[test]
    fn no_text_panics(text in "[a-z/.+*(){}\\[\\]\"0-9 ,<=!é-]{0,40}") {
        if let Ok(formula) = text.parse::<Formula>() {
            let points = vec![Points::from_seconds(&[(0.0, 1.0), (1.0, 2.0)]); formula.fields().len()];
            let _ = formula.eval(&points);
        }
    }
}
