//! Names of learned models, and which model a command means.
//!
//! The number of a model in a message changes when another one is deleted or merged, its name does not. A command that
//! names both is obeyed if the name is found, and refused otherwise.

use rcs_msg::rcs::ModelToDelete;

const PREFIX: &str = "learned ";

/// The name of the model that was learned as the `number`th one.
pub fn learned_name(number: u64) -> String {
    format!("{PREFIX}{number}")
}

/// The greatest number in names that [`learned_name`] has made; 0 without any.
pub fn last_learned<'a>(names: impl Iterator<Item = &'a str>) -> u64 {
    let number = |name: &str| name.strip_prefix(PREFIX)?.parse::<u32>().ok();
    names.filter_map(number).map(u64::from).max().unwrap_or(0)
}

/// The index of the model that a command means, among the names of the models as they are now, in their order. A command
/// without a name means the model with its number.
pub fn model_to_delete(names: &[&str], wanted: &ModelToDelete) -> Result<usize, String> {
    let (number, name) = (wanted.number as usize, wanted.name.as_str());
    let there_are = format!("there are {}", names.len());
    match names.get(number) {
        Some(found) if name.is_empty() || *found == name => return Ok(number),
        None if name.is_empty() => return Err(format!("there is no model {number}; {there_are}")),
        _ => {}
    }
    let mut same = (0..names.len()).filter(|index| names[*index] == name);
    match (same.next(), same.next()) {
        (Some(index), None) => Ok(index),
        (None, _) => Err(format!("there is no model {name:?} any more; {there_are}")),
        (Some(_), Some(_)) => {
            Err(format!("model {number} is not {name:?} any more, and several have that name"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_means_a_model_by_its_name_wherever_it_is_now() {
        let wanted = |number, name: &str| {
            let model = ModelToDelete { output: "models".to_owned(), number, name: name.to_owned() };
            model_to_delete(&["learned 1", "fence", "learned 4", "fence"], &model)
        };
        assert_eq!(wanted(2, "learned 4"), Ok(2));
        assert_eq!(wanted(3, "learned 4"), Ok(2), "another one was deleted before it");
        assert_eq!(wanted(9, "learned 1"), Ok(0));
        assert_eq!(wanted(3, "fence"), Ok(3), "of several of the same name, the number decides");
        assert_eq!(wanted(1, ""), Ok(1), "an older recording names the number alone");
        assert_eq!(wanted(4, ""), Err("there is no model 4; there are 4".to_owned()));
        assert_eq!(
            wanted(2, "learned 3"),
            Err("there is no model \"learned 3\" any more; there are 4".to_owned())
        );
        let several = "model 2 is not \"fence\" any more, and several have that name";
        assert_eq!(wanted(2, "fence"), Err(several.to_owned()));
    }

    #[test]
    fn new_names_follow_the_greatest_number_of_a_file() {
        let last = last_learned(["learned 3", "mulch", "learned 12", "learned x"].into_iter());
        assert_eq!(learned_name(last + 1), "learned 13");
        assert_eq!(last_learned(std::iter::empty()), 0);
    }
}
