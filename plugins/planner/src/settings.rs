//! The rules of cost, as the parameters of the processes give them.

use crate::proto::TerrainCosts;
use crate::terrain::Rules;

/// What the planner of a larger map has sent longer ago than this does not count, s: it sends ten messages in this time.
pub(crate) const FAR_TIMEOUT_S: f64 = 5.0;

/// Refuses a table that is not ascending.
pub(crate) fn check_costs(costs: Option<&TerrainCosts>) -> Result<(), String> {
    let table = costs.map_or(&[][..], |costs| &costs.table);
    if table.is_empty() {
        return Err("costs.table: expected at least one class of terrain".to_owned());
    }
    match table.windows(2).find(|pair| pair[0].up_to >= pair[1].up_to) {
        Some(pair) => Err(format!(
            "costs.table: {} comes after {}, expected classes in ascending order of up_to",
            pair[1].up_to, pair[0].up_to
        )),
        None => Ok(()),
    }
}

/// The rules without heading and relief, which belong to the planner alone.
pub(crate) fn rules_of(costs: Option<&TerrainCosts>) -> Rules {
    let costs = costs.cloned().unwrap_or_default();
    let half_m = costs.vehicle_width_m / 2.0;
    Rules {
        table: costs.table.iter().map(|class| (class.up_to as u8, class.cost as u8)).collect(),
        unknown: costs.unknown_cost as u8,
        unknown_near: costs.unknown_cost as u8,
        half_width_m: half_m,
        least_room_m: half_m + costs.clearance_m,
        far_room_m: half_m + costs.clearance_m,
        wish_room_m: half_m + costs.wish_clearance_m.max(costs.clearance_m),
        clearance: costs.clearance_cost,
        ..Rules::plain()
    }
}
