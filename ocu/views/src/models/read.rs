//! Reads models from any message: its list of models, their histograms and their numbers.

use super::patch::Patch;
use ocu_ui::format;
use rcs_msg::{AnyMessage, Stamp, Value};

/// Most bins that a histogram is read with.
const MOST_BINS: usize = 1 << 16;

/// The models of a message.
#[derive(Debug, Default)]
pub(super) struct Models {
    pub(super) models: Vec<Model>,
}

/// One model.
#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) name: String,
    /// Whether the message names it; else it is called by its number.
    pub(super) is_named: bool,
    /// What kind of model it is; empty if it does not say.
    pub(super) kind: String,
    pub(super) histograms: Vec<Histogram>,
    pub(super) numbers: Vec<(String, Number)>,
    /// What it was learned from, or else the colours of its histogram.
    pub(super) patch: Option<Patch>,
}

/// A number of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Plain(f64),
    /// 0 to 1, shown as a bar.
    Fraction(f64),
    Time(Stamp),
}

impl Number {
    pub(super) fn text(self, now: Stamp) -> String {
        match self {
            Number::Plain(value) => format::number(value),
            Number::Fraction(value) => format!("{:3.0} %", value * 100.0),
            Number::Time(time) => format!("{} ago", format::age(now.seconds_since(time).max(0.0))),
        }
    }
}

/// Counts by bin.
#[derive(Debug, PartialEq)]
pub(super) struct Histogram {
    pub(super) name: String,
    /// Names of the outer and of the inner axis, if there are two.
    pub(super) axes: Option<[String; 2]>,
    /// Bins of the inner axis, and all counts, the outer axis first.
    pub(super) columns: usize,
    pub(super) counts: Vec<f32>,
}

impl Models {
    /// The pictures of the models, in their order.
    pub(super) fn patches(&self) -> Vec<Option<&Patch>> {
        self.models.iter().map(|model| model.patch.as_ref()).collect()
    }

    /// What the message calls a model; empty if it has no name there.
    pub(super) fn name_of(&self, index: usize) -> &str {
        let named = self.models.get(index).filter(|model| model.is_named);
        named.map_or("", |model| model.name.as_str())
    }

    /// An error says what the message lacks.
    pub(super) fn of(message: &AnyMessage) -> Result<Self, String> {
        let value = message.value().map_err(|error| error.to_string())?;
        let is_list = |value: &Value| match value {
            Value::List(items) => items.iter().all(|item| matches!(item, Value::Message(_))),
            _ => false,
        };
        let fields = value.fields();
        let found = fields.iter().find(|(_, value)| is_list(value) && value.len().unwrap_or(0) > 0);
        let Some((_, value)) = found.or_else(|| fields.iter().find(|(_, value)| is_list(value))) else {
            return Err(format!("{} has no list of models", message.schema().name()));
        };
        let Value::List(items) = value else { return Ok(Self::default()) };
        let models = items.iter().enumerate().map(|(index, item)| Model::of(index, item)).collect();
        Ok(Self { models })
    }
}

impl Model {
    fn of(index: usize, item: &Value) -> Self {
        let mut model = Self { name: format!("model {}", index + 1), ..Self::default() };
        let bins: Vec<(&str, usize)> = item
            .fields()
            .iter()
            .filter_map(|(name, value)| Some((name.strip_suffix("_bins")?, value.as_f64()? as usize)))
            .collect();
        for (name, value) in item.fields() {
            let time = value.as_stamp();
            match value {
                Value::Text(text) if name == "name" && !text.is_empty() => {
                    model.name.clone_from(text);
                    model.is_named = true;
                }
                Value::Enum { name: kind, .. } if model.kind.is_empty() => model.kind = words(kind),
                Value::List(_) | Value::Packed(_) => {
                    model.histograms.extend(Histogram::of(name, value, &bins));
                }
                _ if name.ends_with("_bins") => {}
                Value::Message(_) if time.is_none() => model.patch = model.patch.or_else(|| Patch::of(value)),
                _ if time.is_some() => {
                    model.numbers.extend(time.map(|time| (spoken(name), Number::Time(time))));
                }
                _ => model.numbers.extend(value.as_f64().map(|number| {
                    let is_fraction = name.ends_with("fraction") && (0.0..=1.0).contains(&number);
                    let number = if is_fraction { Number::Fraction(number) } else { Number::Plain(number) };
                    (spoken(name), number)
                })),
            }
        }
        model.patch = model.patch.or_else(|| model.histograms.iter().find_map(Histogram::swatch));
        // What says most comes first.
        model.numbers.sort_by_key(|(_, number)| !matches!(number, Number::Fraction(_)));
        model
    }
}

impl Histogram {
    fn of(name: &str, value: &Value, bins: &[(&str, usize)]) -> Option<Self> {
        let length = value.len().filter(|length| (2..=MOST_BINS).contains(length))?;
        let count = |index: usize| value.item(index)?.as_f64().map(|count| count as f32);
        let counts: Option<Vec<f32>> = (0..length).map(count).collect();
        let mut histogram = Self { name: spoken(name), axes: None, columns: length, counts: counts? };
        if let [(outer, rows), (inner, columns)] = *bins
            && rows.checked_mul(columns) == Some(length)
        {
            histogram.axes = Some([spoken(outer), spoken(inner)]);
            histogram.columns = columns;
        }
        Some(histogram)
    }

    /// Its colours, if it is one over red and green.
    pub(super) fn swatch(&self) -> Option<Patch> {
        Patch::swatch(self.axes.as_ref()?, self.columns, &self.counts)
    }

    /// The greatest count; at least a little, so that one can divide by it.
    pub(super) fn most(&self) -> f32 {
        self.counts.iter().copied().filter(|count| count.is_finite()).fold(1e-6, f32::max)
    }
}

/// `obstacle_fraction` as it is said.
fn spoken(name: &str) -> String {
    name.replace('_', " ")
}

/// The last words of an enum value: `COLOR_MODEL_GROUND` as `ground`.
fn words(name: &str) -> String {
    name.rsplit('_').next().unwrap_or(name).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_with_two_numbers_of_bins_has_two_axes_and_others_have_one() {
        let list = |length: i64| Value::List((0..length).map(Value::Int).collect());
        let item = Value::Message(vec![
            ("name".to_owned(), Value::Text("mulch".to_owned())),
            ("red_bins".to_owned(), Value::Uint(2)),
            ("green_bins".to_owned(), Value::Uint(3)),
            ("counts".to_owned(), list(6)),
            ("texture".to_owned(), list(8)),
            ("single".to_owned(), list(1)),
            ("uses".to_owned(), Value::Uint(7)),
            ("obstacle_fraction".to_owned(), Value::Float(0.25)),
        ]);
        let model = Model::of(0, &item);
        assert_eq!((model.name.as_str(), model.histograms.len()), ("mulch", 2));
        let counts = &model.histograms[0];
        assert_eq!(counts.axes, Some(["red".to_owned(), "green".to_owned()]));
        assert_eq!((counts.columns, counts.most()), (3, 5.0));
        assert_eq!((model.histograms[1].axes.clone(), model.histograms[1].columns), (None, 8));
        let expected = [("obstacle fraction", Number::Fraction(0.25)), ("uses", Number::Plain(7.0))];
        assert_eq!(model.numbers, expected.map(|(name, number)| (name.to_owned(), number)));
    }
}
