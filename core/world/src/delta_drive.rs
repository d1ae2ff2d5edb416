//! Maps of a drive, for tests.

use rcs_geom::DVec2;
use rcs_msg::Stamp;

use crate::{HeightStats, Map, MapMessage, MapOptions, Source, SourceKind, Sources, Vote, VoteRule, Weights};

/// A drive: votes at various places around a moving vehicle, from a growing set of sources.
pub(crate) struct Drive {
    map: Map,
    sources: Sources,
    random: u64,
    at: DVec2,
    pub(crate) sequence: u32,
}

impl Drive {
    pub(crate) fn new(seed: u64) -> Drive {
        let sources = [Source::STEREO].into_iter().collect();
        Drive { map: Map::new(0.2).unwrap(), sources, random: seed, at: DVec2::ZERO, sequence: 0 }
    }

    fn below(&mut self, n: u64) -> u64 {
        self.random =
            self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 33) % n
    }

    pub(crate) fn next(&mut self) -> MapMessage {
        self.sequence += 1;
        let time = Stamp(1_700_000_000_000_000_000 + u64::from(self.sequence) * 200_000_000);
        if self.below(20) == 0 {
            self.map.clear();
        }
        let far = if self.below(15) == 0 { 60.0 } else { 0.5 };
        let step = [self.below(100), self.below(100)].map(|n| n as f64 * 0.01 - 0.3);
        self.at += DVec2::from_array(step) * far;
        self.map.recentre(self.at).unwrap();
        let south_west = self.map.grid().bounds().south_west;
        for _ in 0..self.below(400) {
            let (x, y) = (60 + self.below(60) as i64, 60 + self.below(60) as i64);
            // One of the sources is not bundled with the program.
            let name = ["stereo", "color", "terrain", "radar", "bumper", "infrared"][self.below(6) as usize];
            let source: Source = name.parse().unwrap();
            self.sources.insert(source);
            let cell = south_west.offset(x, y);
            let is_learned = Weights::default().get(source).kind == SourceKind::Learned;
            let model = if is_learned { self.below(256) as u8 } else { 0 };
            let vote = Vote { model, ..Vote::from(self.below(251) as u8) };
            self.map.vote(cell, source, vote, self.sequence, time, VoteRule::default());
            let mut ground = HeightStats::default();
            (0..self.below(4)).for_each(|_| ground.add(self.below(1000) as f32 * 0.001));
            let cell = self.map.cell_mut(cell).unwrap();
            cell.observe_heights(&ground, &HeightStats::default(), 0.1, time, VoteRule::default());
        }
        let weights = Weights::default().with(Source::TERRAIN, self.below(3) as f32);
        let options = MapOptions { sources: self.sources.clone(), heights: true, weights };
        MapMessage::new(self.map.clone(), "local", time, options)
    }
}
