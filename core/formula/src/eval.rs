//! Operands and operators of formulas. exmex parses the text, keeps the order of operators and calls these functions.

use crate::functions::{self, WIDTH_S};
use crate::points::{Over, Points};
use crate::spectrum::spectrum;
use exmex::{BinOp, MakeOperators, Operator};
use std::str::FromStr;
use std::sync::Arc;

/// An operand or a result.
#[derive(Clone, Debug)]
pub(crate) enum Data {
    Number(f64),
    Points(Points),
    /// The name of a state, or a text.
    Name(Arc<str>),
    /// Operands that did not fit.
    Wrong(Arc<str>),
}

impl Default for Data {
    fn default() -> Self {
        Self::Number(0.0)
    }
}

impl FromStr for Data {
    type Err = std::num::ParseFloatError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        text.parse().map(Self::Number)
    }
}

fn wrong(text: impl Into<Arc<str>>) -> Data {
    Data::Wrong(text.into())
}

/// Applies a function to a number or to each value.
fn each(data: Data, f: impl Fn(f64) -> f64) -> Data {
    match data {
        Data::Number(number) => Data::Number(f(number)),
        Data::Points(points) => Data::Points(points.with(points.values.iter().map(|&v| f(v)).collect())),
        Data::Name(name) => wrong(format!("{name:?} is a name, expected a number or a field")),
        wrong @ Data::Wrong(_) => wrong,
    }
}

/// Applies a function to two numbers, or at each time of the first series.
fn both(a: Data, b: Data, f: impl Fn(f64, f64) -> f64) -> Data {
    match (a, b) {
        (wrong @ Data::Wrong(_), _) | (_, wrong @ Data::Wrong(_)) => wrong,
        (Data::Number(a), Data::Number(b)) => Data::Number(f(a, b)),
        (a, Data::Number(b)) => each(a, |a| f(a, b)),
        (Data::Number(a), b) => each(b, |b| f(a, b)),
        (Data::Points(a), Data::Points(b)) if a.over != b.over => {
            wrong("a spectrum is over frequency, expected another spectrum or a number beside it")
        }
        (Data::Points(a), Data::Points(b)) => {
            let b = b.at(&a.stamps);
            Data::Points(a.with(a.values.iter().zip(b.iter()).map(|(&a, &b)| f(a, b)).collect()))
        }
        (Data::Name(name), _) | (_, Data::Name(name)) => {
            wrong(format!("{name:?} is a name, which can only be compared with == and !="))
        }
    }
}

/// A comparison: at a gap it is not true.
fn truth(data: Data) -> Data {
    match data {
        Data::Points(points) => Data::Points(points.as_truth()),
        other => other,
    }
}

fn as_number(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn compare(a: Data, b: Data, f: impl Fn(f64, f64) -> bool) -> Data {
    truth(both(a, b, |a, b| as_number(f(a, b))))
}

/// Whether a value is true; a gap is not.
fn is_true(value: f64) -> bool {
    value != 0.0 && !value.is_nan()
}

/// Equality (if `wanted`) or inequality, also of a state with its name. At a gap neither is true. A name that an enum does
/// not have is refused; a text that no message has had so far equals none of them.
fn equal(a: Data, b: Data, wanted: bool) -> Data {
    match (a, b) {
        (Data::Points(points), Data::Name(name)) | (Data::Name(name), Data::Points(points)) => {
            if !points.are_states() && !points.is_empty() {
                return wrong(format!("got numbers, expected states to compare with {name:?}"));
            }
            let number =
                points.names.iter().find(|(_, known)| **known == name).map(|(&number, _)| number as f64);
            let is_known = points.states.is_empty() || points.states.iter().any(|state| **state == *name);
            if number.is_none() && !is_known {
                return wrong(format!("no state {name:?}, expected one of {}", points.states.join(", ")));
            }
            let is = |value: f64| !value.is_nan() && (number == Some(value)) == wanted;
            truth(each(Data::Points(points), |value| as_number(is(value))))
        }
        (a, b) => compare(a, b, |a, b| !a.is_nan() && !b.is_nan() && (a == b) == wanted),
    }
}

/// Applies a function of a whole series.
fn whole(data: Data, f: impl Fn(&Points) -> Points) -> Data {
    match data {
        Data::Points(points) if points.over == Over::Frequency => {
            wrong("a function over time needs a field, got a spectrum")
        }
        Data::Points(points) => Data::Points(f(&points)),
        wrong @ Data::Wrong(_) => wrong,
        _ => wrong("a function over time needs a field, got a single value"),
    }
}

/// Applies a function of a whole series and the width of a window.
fn windowed(data: Data, width: Data, f: fn(&Points, f64) -> Points) -> Data {
    match width {
        Data::Number(width_s) if width_s >= 0.0 => whole(data, |points| f(points, width_s)),
        wrong @ Data::Wrong(_) => wrong,
        _ => wrong("the width of a window is a number of seconds, at least 0"),
    }
}

fn binary(apply: fn(Data, Data) -> Data, prio: i64) -> BinOp<Data> {
    BinOp { apply, prio, is_commutative: false }
}

/// The operators and functions of formulas, for exmex.
#[derive(Clone, Debug)]
pub(crate) struct Operators;

impl MakeOperators<Data> for Operators {
    fn make<'a>() -> Vec<Operator<'a, Data>> {
        let bin = |name, prio, apply| Operator::make_bin(name, binary(apply, prio));
        let call = |name, apply| Operator::make_bin(name, binary(apply, 9));
        let unary = Operator::make_unary;
        vec![
            bin("||", 0, |a, b| compare(a, b, |a, b| is_true(a) || is_true(b))),
            bin("&&", 1, |a, b| compare(a, b, |a, b| is_true(a) && is_true(b))),
            bin("==", 2, |a, b| equal(a, b, true)),
            bin("!=", 2, |a, b| equal(a, b, false)),
            bin("<=", 3, |a, b| compare(a, b, |a, b| a <= b)),
            bin(">=", 3, |a, b| compare(a, b, |a, b| a >= b)),
            bin("<", 3, |a, b| compare(a, b, |a, b| a < b)),
            bin(">", 3, |a, b| compare(a, b, |a, b| a > b)),
            Operator::make_bin_unary("+", binary(|a, b| both(a, b, |a, b| a + b), 4), |a| a),
            Operator::make_bin_unary("-", binary(|a, b| both(a, b, |a, b| a - b), 4), |a| each(a, |a| -a)),
            bin("*", 5, |a, b| both(a, b, |a, b| a * b)),
            bin("/", 5, |a, b| both(a, b, |a, b| a / b)),
            bin("%", 5, |a, b| both(a, b, f64::rem_euclid)),
            bin("^", 6, |a, b| both(a, b, libm::pow)),
            unary("!", |a| truth(each(a, |a| as_number(a == 0.0)))),
            Operator::make_bin_unary("smooth", binary(|a, w| windowed(a, w, functions::smooth), 9), |a| {
                whole(a, |points| functions::smooth(points, WIDTH_S))
            }),
            Operator::make_bin_unary(
                "deviation",
                binary(|a, w| windowed(a, w, functions::deviation), 9),
                |a| whole(a, |points| functions::deviation(points, WIDTH_S)),
            ),
            unary("derivative", |a| whole(a, functions::derivative)),
            unary("integral", |a| whole(a, functions::integral)),
            unary("spectrum", |a| whole(a, spectrum)),
            unary("difference", |a| whole(a, functions::difference)),
            call("angle_difference", |a, b| both(a, b, functions::angle_difference)),
            unary("absolute", |a| each(a, f64::abs)),
            unary("negative", |a| each(a, |a| -a)),
            unary("square_root", |a| each(a, libm::sqrt)),
            unary("sine", |a| each(a, libm::sin)),
            unary("cosine", |a| each(a, libm::cos)),
            call("arc_tangent", |a, b| both(a, b, libm::atan2)),
            unary("degrees", |a| each(a, f64::to_degrees)),
            unary("exponential", |a| each(a, libm::exp)),
            unary("logarithm", |a| each(a, libm::log)),
            unary("round", |a| each(a, f64::round)),
            call("minimum", |a, b| both(a, b, f64::min)),
            call("maximum", |a, b| both(a, b, f64::max)),
        ]
    }
}
