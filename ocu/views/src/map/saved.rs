//! What a layout stores of a map.

use crate::canvas::Viewport;
use crate::cloud_look::CloudLook;
use ocu_ui::palette::MapPalette;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Saved settings of a layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct LayerState {
    pub(super) shown: bool,
    pub(super) opacity: f32,
    /// Field by which a grid is coloured; the first choice where `None`.
    pub(super) shade: Option<String>,
    /// How a cloud is drawn.
    pub(super) cloud: CloudLook,
}

impl Default for LayerState {
    fn default() -> Self {
        Self { shown: true, opacity: 1.0, shade: None, cloud: CloudLook::default() }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Saved {
    /// Frame of the map; `None` to select one automatically.
    pub(super) frame: Option<String>,
    /// Colours of costs.
    pub(super) palette: MapPalette,
    /// Layers that were changed by hand, by topic.
    pub(super) layers: BTreeMap<String, LayerState>,
    /// Whether tracks without a transform are aligned with another one by their first metres.
    pub(super) align: bool,
    /// Whether the layer panel is open; `None` to open it where there is room.
    pub(super) panel: Option<bool>,
    /// Whether the legend is unfolded; `None` if it was never folded.
    pub(super) legend: Option<bool>,
    /// Where it looks; `None` to fit everything.
    pub(super) viewport: Option<Viewport>,
    /// Whether the vehicle stays in the middle.
    pub(super) follows: bool,
    /// Whether the map is turned so that the vehicle heads up.
    pub(super) vehicle_up: bool,
}

impl Default for Saved {
    fn default() -> Self {
        Self {
            frame: None,
            palette: MapPalette::default(),
            layers: BTreeMap::new(),
            align: true,
            panel: None,
            legend: None,
            viewport: None,
            follows: false,
            vehicle_up: false,
        }
    }
}
