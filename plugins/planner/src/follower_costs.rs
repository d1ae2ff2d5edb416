//! The costs on which the follower chooses arcs: of the map, and of what the bumper hit alone.

use crate::costs::{CostGrid, CostGridError};
use crate::map_reader::MapReader;
use crate::modes::Obstacles;
use crate::proto::TerrainCosts;
use crate::sensed::Sensed;
use crate::settings::rules_of;
use crate::terrain::{Past, Rules, Terrain};
use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::Grid;
use rcs_runtime::Msg;

/// Costs of the newest map.
#[derive(Debug, Default)]
pub(crate) struct Costs {
    reader: MapReader,
    terrain: Terrain,
    /// Of the newest map.
    known: Option<Known>,
}

/// The costs of a map.
#[derive(Debug)]
struct Known {
    /// The sequence of the map.
    sequence: u64,
    rules: Rules,
    of_map: CostGrid,
    /// Of what the bumper hit alone, once a mode has asked for it.
    of_hits: Option<CostGrid>,
}

impl Costs {
    /// Makes the costs of a map, if they are not those of the last one.
    pub(crate) fn take(
        &mut self,
        map: &Msg<Grid>,
        local: &str,
        costs: Option<&TerrainCosts>,
    ) -> Result<(), String> {
        let (sequence, rules) = (map.header().sequence, rules_of(costs));
        if self.known.as_ref().is_some_and(|known| (known.sequence, &known.rules) == (sequence, &rules)) {
            return Ok(());
        }
        self.known = None;
        self.reader.read(map, local)?;
        let of_map = costs_of(&self.reader.sensed, &mut self.terrain, &rules);
        let of_map = of_map.map_err(|error| error.to_string())?;
        self.known = Some(Known { sequence, rules, of_map, of_hits: None });
        Ok(())
    }

    /// Makes the costs of these obstacles, if [`Costs::take`] has not: few modes ask for those of the bumper.
    pub(crate) fn prepare(&mut self, obstacles: Obstacles) {
        let is_asked = |known: &&mut Known| obstacles == Obstacles::Bumper && known.of_hits.is_none();
        let Some(known) = self.known.as_mut().filter(is_asked) else { return };
        let sensed = &self.reader.sensed;
        let hits = Sensed {
            columns: sensed.columns,
            cell_size_m: sensed.cell_size_m,
            corner: sensed.corner,
            fused: vec![0; sensed.fused.len()],
            bumped: sensed.bumped.clone(),
            remembered: Vec::new(),
            seen_from_dm: Vec::new(),
        };
        // As many cells as the map has, whose costs were made.
        known.of_hits = costs_of(&hits, &mut Terrain::default(), &known.rules).ok();
    }

    /// The costs, if [`Costs::take`] and [`Costs::prepare`] have made them.
    pub(crate) fn of(&self, obstacles: Obstacles) -> Option<&CostGrid> {
        let known = self.known.as_ref()?;
        match obstacles {
            Obstacles::Map => Some(&known.of_map),
            Obstacles::Bumper => known.of_hits.as_ref(),
        }
    }

    /// The map.
    pub(crate) fn sensed(&self) -> &Sensed {
        &self.reader.sensed
    }

    /// Distance between the side of a vehicle at a position and the nearest obstacle, m; at most the desired clearance.
    pub(crate) fn room_m(&self, position: DVec2) -> f64 {
        let Some(Known { rules, .. }) = &self.known else { return 0.0 };
        let half_m = rules.half_width_m;
        (self.terrain.room_m(&self.reader.sensed, position, rules) - half_m).max(0.0)
    }
}

/// Costs without heading and relief, which do not depend on the vehicle's pose.
fn costs_of(sensed: &Sensed, terrain: &mut Terrain, rules: &Rules) -> Result<CostGrid, CostGridError> {
    terrain.costs(sensed, &Pose::IDENTITY, &Past::default(), rules)
}
