//! The costs on which the follower chooses arcs: of the map, and of what the bumper hit alone.

use crate::costs::CostGrid;
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
    /// Sequence of the map, rules, costs of the map and of what the bumper hit.
    known: Option<(u64, Rules, [CostGrid; 2])>,
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
        if self.known.as_ref().is_some_and(|(known, by, _)| (*known, by) == (sequence, &rules)) {
            return Ok(());
        }
        self.known = None;
        self.reader.read(map, local)?;
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
        // Without heading and relief, costs do not depend on the vehicle's pose.
        let of = |sensed: &Sensed, terrain: &mut Terrain| {
            terrain
                .costs(sensed, &Pose::IDENTITY, &Past::default(), &rules)
                .map_err(|error| error.to_string())
        };
        let of_hits = of(&hits, &mut Terrain::default())?;
        let of_map = of(sensed, &mut self.terrain)?;
        self.known = Some((sequence, rules, [of_map, of_hits]));
        Ok(())
    }

    /// The costs, if [`Costs::take`] has made them.
    pub(crate) fn of(&self, obstacles: Obstacles) -> Option<&CostGrid> {
        let (.., [of_map, of_hits]) = self.known.as_ref()?;
        Some(match obstacles {
            Obstacles::Map => of_map,
            Obstacles::Bumper => of_hits,
        })
    }

    /// The map.
    pub(crate) fn sensed(&self) -> &Sensed {
        &self.reader.sensed
    }

    /// Distance between the side of a vehicle at a position and the nearest obstacle, m; at most the desired clearance.
    pub(crate) fn room_m(&self, position: DVec2) -> f64 {
        let Some((_, rules, _)) = &self.known else { return 0.0 };
        let half_m = rules.half_width_m;
        (self.terrain.room_m(&self.reader.sensed, position, rules) - half_m).max(0.0)
    }
}
