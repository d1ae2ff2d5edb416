//! Formulas: parsed texts that read fields.

use crate::error::FormulaError;
use crate::eval::{Data, Operators};
use crate::points::Points;
use crate::text::{FieldRef, Operand, operands};
use exmex::{Express, FlatEx};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::str::FromStr;
use std::sync::Arc;

/// A formula over fields.
#[derive(Clone)]
pub struct Formula {
    text: String,
    fields: Vec<FieldRef>,
    operands: Vec<Operand>,
    expression: FlatEx<Data, Operators>,
}

impl fmt::Debug for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Formula({:?})", self.text)
    }
}

impl fmt::Display for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl FromStr for Formula {
    type Err = FormulaError;

    fn from_str(text: &str) -> Result<Self, FormulaError> {
        let found = operands(text)?;
        let mut fields: Vec<FieldRef> = Vec::new();
        for operand in &found.operands {
            if let Operand::Field(field) = operand
                && !fields.contains(field)
            {
                fields.push(field.clone());
            }
        }
        let parse = || -> Result<FlatEx<Data, Operators>, exmex::ExError> {
            let expression = FlatEx::<Data, Operators>::parse(&found.text)?;
            // Some mistakes are found only when values are put in.
            expression.eval(&vec![Data::Number(0.0); found.operands.len()])?;
            Ok(expression)
        };
        // The parser is a library, which reads a text of a user.
        let parsed = catch_unwind(AssertUnwindSafe(parse)).ok().and_then(Result::ok);
        let expression = parsed.ok_or_else(|| FormulaError::Syntax {
            column: 1,
            problem: "not a formula, expected values with operators between them".to_owned(),
            text: text.to_owned(),
        })?;
        Ok(Self { text: text.to_owned(), fields, operands: found.operands, expression })
    }
}

impl Formula {
    /// The fields that it reads, in the order of their first mention.
    pub fn fields(&self) -> &[FieldRef] {
        &self.fields
    }

    /// The field that it is, if it is nothing else.
    pub fn as_field(&self) -> Option<&FieldRef> {
        match self.operands.as_slice() {
            [Operand::Field(field)] if self.text.trim() == field.to_string() => Some(field),
            _ => None,
        }
    }

    /// Its value from the points of [`Formula::fields`], in that order. A formula of several fields has a value at each
    /// time of the first operand of an operator.
    pub fn eval(&self, points: &[Points]) -> Result<Points, FormulaError> {
        let data = |operand: &Operand| match operand {
            Operand::Number(number) => Data::Number(*number),
            Operand::Name(name) => Data::Name(name.as_str().into()),
            Operand::Field(field) => {
                let index = self.fields.iter().position(|known| known == field);
                Data::Points(index.and_then(|index| points.get(index)).cloned().unwrap_or_default())
            }
        };
        let values: Vec<Data> = self.operands.iter().map(data).collect();
        let wrong = |text: String| FormulaError::Operands(format!("{text}: {}", self.text));
        match self.expression.eval(&values).map_err(|error| wrong(error.to_string()))? {
            Data::Points(points) => Ok(points),
            Data::Number(number) => {
                // A constant holds wherever a field is known, and at the beginning of time otherwise.
                let stamps =
                    points.first().map_or_else(|| Arc::from([rcs_msg::Stamp(0)]), |p| Arc::clone(&p.stamps));
                Ok(Points::new(Arc::clone(&stamps), vec![number; stamps.len()]))
            }
            Data::Name(name) => Err(wrong(format!("{name:?} is the name of a state, expected a field"))),
            Data::Wrong(text) => Err(wrong(text.to_string())),
        }
    }
}
