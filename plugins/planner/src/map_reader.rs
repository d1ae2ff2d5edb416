//! Reads the fused costs of a map message.

use crate::sensed::Sensed;
use rcs_msg::foxglove::Grid;
use rcs_runtime::Msg;
use rcs_world::{GridView, MAX_COST, NumericType, OBSTACLE_COST, OBSTACLE_SEEN_FROM, Source};

/// The map that was read last, and the memory for reading.
#[derive(Debug, Default)]
pub(crate) struct MapReader {
    pub(crate) sensed: Sensed,
    costs: Vec<u8>,
    confidences: Vec<u8>,
}

impl MapReader {
    /// Reads the fused costs of a map, from how near its obstacles were seen, where the bumper hit, and where an earlier
    /// run knew an obstacle.
    pub(crate) fn read(&mut self, map: &Msg<Grid>, local: &str) -> Result<(), String> {
        let view = GridView::of(map.message()).map_err(|error| error.to_string())?;
        let (size, corner) = (view.cell_size_m(), view.frame_from_grid());
        if view.frame_id() != local {
            return Err(format!("frame is {:?}, expected {local:?}", view.frame_id()));
        }
        if size.x != size.y || corner.rotation.w.abs() < 1.0 - 1e-9 {
            let what = if size.x == size.y { "turned" } else { "not square" };
            return Err(format!(
                "cells of {} m by {} m are {what}, expected square ones along the axes",
                size.x, size.y
            ));
        }
        let byte = |name: &str| view.field_of(name, NumericType::Uint8);
        byte("cost").map_err(|error| error.to_string())?.bytes_into(&mut self.sensed.fused);
        match byte(OBSTACLE_SEEN_FROM) {
            Ok(from_dm) => from_dm.bytes_into(&mut self.sensed.seen_from_dm),
            Err(_) => self.sensed.seen_from_dm.clear(),
        }
        self.sensed.columns = view.columns();
        self.sensed.cell_size_m = size.x;
        self.sensed.corner = corner.translation.truncate();
        for (source, obstacles) in
            [(Source::BUMPER, &mut self.sensed.bumped), (Source::MEMORY, &mut self.sensed.remembered)]
        {
            obstacles.clear();
            if let (Ok(cost), Ok(confidence)) =
                (byte(&format!("cost.{source}")), byte(&format!("conf.{source}")))
            {
                cost.bytes_into(&mut self.costs);
                confidence.bytes_into(&mut self.confidences);
                let is_obstacle = |(&cost, &confidence): (&u8, &u8)| {
                    confidence > 0 && (OBSTACLE_COST..=MAX_COST).contains(&cost)
                };
                obstacles.extend(self.costs.iter().zip(&self.confidences).map(is_obstacle));
            }
        }
        Ok(())
    }
}
