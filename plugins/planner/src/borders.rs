//! On which side of the border of a keep-out zone the vehicle stands.
//!
//! The cells that a border crosses are forbidden, so no path leads through a zone that is thinner than a cell. This does not
//! hold for a vehicle that stands in such a cell: from there it could step to both sides.

use crate::place::Place;
use crate::sensed::Sensed;
use crate::zones::Zones;
use rcs_geom::DVec2;

/// Has a vehicle that stands where it is allowed leave its cell on its side of the borders around it: of the cells around its
/// own, those that lie beyond a border are forbidden, too. Returns whether it can step to one of the others; `position` is in
/// the map's frame, m, and `forbidden` are the cells of the map in which it must not drive.
pub(crate) fn keep_side(forbidden: &mut [bool], sensed: &Sensed, zones: &Zones, position: DVec2) -> bool {
    let Some(start) = sensed.place(position) else { return true };
    let beside = block(sensed, forbidden.len(), start, 1);
    if !beside.iter().any(|&place| forbidden[sensed.index(place)]) {
        return true;
    }
    let is_beyond = |place: Place| {
        let centre = sensed.centre(place);
        zones.forbid(centre) || zones.separate(position, centre)
    };
    for &place in &beside {
        forbidden[sensed.index(place)] |= is_beyond(place);
    }
    if leads_out(forbidden, sensed, start, &beside) {
        return true;
    }
    // In the corner of a cell that a border cuts off, borders cross all cells beside it. Those whose middle lies on the
    // vehicle's side are opened; so that none of them leads beyond the border, the cells around them that lie there are closed.
    for &place in &beside {
        forbidden[sensed.index(place)] = is_beyond(place);
    }
    for place in block(sensed, forbidden.len(), start, 2) {
        forbidden[sensed.index(place)] |= is_beyond(place);
    }
    leads_out(forbidden, sensed, start, &beside)
}

/// The cells of a map of this many cells that are at most this many rows and columns away from one.
fn block(sensed: &Sensed, cells: usize, middle: Place, reach: i32) -> Vec<Place> {
    let rows = (cells / sensed.columns.max(1)) as i32;
    let span = |at: i32, end: i32| (at - reach).max(0)..(at + reach + 1).min(end);
    let columns = span(middle.column, sensed.columns as i32);
    let in_row = |row: i32| columns.clone().map(move |column| Place::new(column, row));
    span(middle.row, rows).flat_map(in_row).collect()
}

/// Whether one of the cells in front of, behind and beside another one may be driven to. A diagonal step needs two of them.
fn leads_out(forbidden: &[bool], sensed: &Sensed, from: Place, beside: &[Place]) -> bool {
    beside.iter().any(|&place| {
        let is_straight = (place.column == from.column) != (place.row == from.row);
        is_straight && !forbidden[sensed.index(place)]
    })
}
