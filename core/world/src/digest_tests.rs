use std::sync::Arc;

use proptest::prelude::*;
use rcs_geom::DVec2;
use rcs_msg::{DeltaCodec as _, schema_of};

use super::*;
use crate::delta_drive::Drive;
use crate::{Cell, Evidence, HeightStats, MAP_CODEC, MapOptions, Source};

/// The digest by a digester that has seen no map before.
fn fresh(message: &MapMessage) -> Digest {
    MAP_CODEC.digester().digest(&message.clone().into_message()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn a_digest_follows_from_the_map_alone(seed: u64) {
        let (mut drive, mut digester) = (Drive::new(seed), MapDigester::default());
        let mut before = Vec::new();
        for _ in 0..40 {
            let map = drive.next();
            let message = map.clone().into_message();
            let digest = digester.digest(&message).unwrap();
            prop_assert_eq!(digest, fresh(&map));
            prop_assert_eq!(digest.bytes, message.bytes().len());
            // The message alone, as it comes back from a snapshot.
            let encoded = AnyMessage::encoded(Arc::clone(schema_of::<Grid>()), message.bytes());
            prop_assert_eq!(MapDigester::default().digest(&encoded), Some(digest));
            prop_assert!(!before.contains(&digest.hash));
            before.push(digest.hash);
        }
    }

    #[test]
    fn a_map_that_shares_no_tile_has_the_same_digest(seed: u64) {
        let mut drive = Drive::new(seed);
        let map = (0..10).map(|_| drive.next()).last().unwrap();
        // Every tile is written with what it holds.
        let mut copy = map.map().clone();
        for tile in 0..copy.grid().tile_count() {
            copy.grid_mut().tile_mut(tile);
        }
        let copy = MapMessage::new(copy, map.frame_id(), map.time(), map.options().clone());
        prop_assert_eq!(fresh(&map), fresh(&copy));
    }
}

#[test]
fn every_number_of_a_message_is_in_the_digest() {
    let mut drive = Drive::new(7);
    let map = (0..10).map(|_| drive.next()).last().unwrap();
    let middle = map.map().grid().centre();
    let mut known = map.map().clone();
    let heights = HeightStats { count: 3, mean: 0.5, variance: 0.25, min: 0.0, max: 1.0 };
    let cell = known.cell_mut(middle).unwrap();
    (cell.ground, cell.obstacle) = (heights, heights);
    let map = MapMessage::new(known, map.frame_id(), map.time(), map.options().clone());
    let with = |change: &dyn Fn(&mut crate::Map)| {
        let mut changed = map.map().clone();
        change(&mut changed);
        fresh(&MapMessage::new(changed, map.frame_id(), map.time(), map.options().clone())).hash
    };
    let cell = |change: fn(&mut Cell)| with(&move |map| change(map.cell_mut(middle).unwrap()));
    let said_by = |source: Source, change: fn(&mut Evidence)| {
        with(&move |map| change(map.layer_mut(source).get_mut(middle).unwrap()))
    };
    let said = |change| said_by(Source::STEREO, change);
    let with_options = |change: fn(&mut MapOptions)| {
        let mut options = map.options().clone();
        change(&mut options);
        fresh(&map.clone().with_options(options)).hash
    };
    let later = rcs_msg::Stamp(map.time().0 + 1);
    let hashes = [
        fresh(&map).hash,
        cell(|cell| cell.updated.0 += 1),
        cell(|cell| cell.ground.count += 1),
        cell(|cell| cell.ground.mean += 1.0),
        cell(|cell| cell.ground.variance += 1.0),
        cell(|cell| cell.ground.min -= 1.0),
        cell(|cell| cell.ground.max += 1.0),
        cell(|cell| cell.obstacle.mean += 1.0),
        cell(|cell| cell.elevation_confidence ^= 1),
        cell(|cell| cell.obstacle_seen_from_dm ^= 1),
        said(|evidence| evidence.cost ^= 1),
        said(|evidence| evidence.confidence ^= 1),
        said(|evidence| evidence.against ^= 1),
        said(|evidence| evidence.backing ^= 1),
        said_by(Source::TERRAIN, |evidence| evidence.model ^= 1),
        said(|evidence| evidence.sequence ^= 1),
        with(&|map| assert!(map.recentre(DVec2::new(1e3, 1e3)).is_some())),
        with_options(|options| options.heights = !options.heights),
        with_options(|options| options.weights = options.weights.clone().with(Source::STEREO, 0.0)),
        with_options(|options| options.sources.insert("sonar".parse().unwrap())),
        fresh(&MapMessage::new(map.map().clone(), "global", map.time(), map.options().clone())).hash,
        fresh(&MapMessage::new(map.map().clone(), map.frame_id(), later, map.options().clone())).hash,
    ];
    for (place, hash) in hashes.iter().enumerate() {
        assert!(
            !hashes[..place].contains(hash),
            "change {place} leaves the digest as it was, or as another does"
        );
    }
}

#[test]
fn a_source_that_has_said_nothing_equals_one_that_is_absent() {
    let mut drive = Drive::new(3);
    let map = drive.next();
    let mut heard = map.map().clone();
    let sonar: Source = "sonar".parse().unwrap();
    heard.layer_mut(sonar);
    let mut options = map.options().clone();
    options.sources.insert(sonar);
    let silent = MapMessage::new(map.map().clone(), "local", map.time(), options.clone());
    assert_eq!(fresh(&silent), fresh(&MapMessage::new(heard, "local", map.time(), options)));
}

#[test]
fn a_grid_that_is_not_one_of_our_maps_has_no_digest() {
    let map = Drive::new(5).next();
    let check = |change: fn(&mut Grid), has_digest: bool| {
        let mut grid = Grid::from(map.clone());
        change(&mut grid);
        let digest = MapDigester::default().digest(&AnyMessage::new(grid));
        assert_eq!(digest.is_some(), has_digest, "{digest:?}");
    };
    check(|_| {}, true);
    check(|grid| *grid = Grid::default(), false);
    check(|grid| grid.pose = None, false);
    check(|grid| grid.pose.as_mut().unwrap().position.as_mut().unwrap().x = 1e300, false);
    check(|grid| grid.cell_size.as_mut().unwrap().x = 0.3, false);
    check(|grid| grid.column_count += 1, false);
    check(|grid| grid.row_stride += 4, false);
    check(|grid| grid.data = grid.data.slice(1..), false);
    check(|grid| grid.column_count = u32::MAX, false);
    check(|grid| (grid.cell_stride, grid.row_stride, grid.data) = (0, 0, bytes::Bytes::new()), false);
}
