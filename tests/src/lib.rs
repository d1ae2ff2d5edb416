//! Scenarios across crates and the rules of the architecture, in one test binary.

#[cfg(test)]
mod architecture;
#[cfg(test)]
mod bundled;
#[cfg(test)]
mod courses;
#[cfg(test)]
mod determinism;
#[cfg(test)]
mod experience;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod judged;
#[cfg(test)]
mod limits;
#[cfg(test)]
mod map_bars;
#[cfg(test)]
mod open_sources;
#[cfg(test)]
mod pages;
#[cfg(test)]
mod random_input;
#[cfg(test)]
mod recorded_maps;
#[cfg(test)]
mod stereo_truth;
#[cfg(test)]
mod torture;
#[cfg(test)]
mod updated_grids;
#[cfg(test)]
mod vehicles;
