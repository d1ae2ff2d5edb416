//! RViz markers as the entities of a scene.
//!
//! A marker is one entity, whose id is `namespace/id`. In a `SceneUpdate` deletions count before entities, whereas the
//! markers of an array count one after the other: a marker that a later one of the same array deletes or replaces is left
//! out. `DELETEALL` deletes the markers of its namespace; without one, and in ROS 1 and Foxy, those of all namespaces,
//! as RViz does.

use super::{Conversion, Header, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::line_primitive::Type as LineType;
use crate::foxglove::scene_entity_deletion::Type as DeletionType;
use crate::foxglove::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, KeyValuePair, LinePrimitive, ModelPrimitive,
    Point3, Pose, Quaternion, SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive, TextPrimitive,
    TriangleListPrimitive, Vector3,
};
use bytes::Bytes;
use glam::{DQuat, DVec3};
use prost_types::Duration;
use std::collections::BTreeMap;

const SCENE: &str = "foxglove.SceneUpdate";

pub(super) const MARKER: Conversion = Conversion {
    from: "visualization_msgs/Marker",
    signature: "iIssiiiddddddddddffffiIb[](ddd)[](ffff)siIss[]B[](ff)sss[]Bb",
    to: SCENE,
    convert: |source| one(source, Edition::Humble),
};

pub(super) const MARKER_ARRAY: Conversion = Conversion {
    from: "visualization_msgs/MarkerArray",
    signature: "[](iIssiiiddddddddddffffiIb[](ddd)[](ffff)siIss[]B[](ff)sss[]Bb)",
    to: SCENE,
    convert: |source| array(source, Edition::Humble),
};

pub(super) const FOXY_MARKER: Conversion = Conversion {
    from: "visualization_msgs/Marker",
    signature: "iIssiiiddddddddddffffiIb[](ddd)[](ffff)ssb",
    to: SCENE,
    convert: |source| one(source, Edition::Foxy),
};

pub(super) const FOXY_MARKER_ARRAY: Conversion = Conversion {
    from: "visualization_msgs/MarkerArray",
    signature: "[](iIssiiiddddddddddffffiIb[](ddd)[](ffff)ssb)",
    to: SCENE,
    convert: |source| array(source, Edition::Foxy),
};

/// Type of a deletion that Foxglove does not have: of the entities of a namespace, which is `id`. Their own ids are the
/// namespace, a slash, and a number.
pub const DELETES_NAMESPACE: i32 = 1000;

/// Of a list of cubes, spheres or points, more than these are left out: each takes seven times its size in the message.
const MOST_LISTED: usize = 100_000;
/// Bytes of a marker without names, at least. A sequence cannot have more markers than the message has room for.
const MARKER_SIZE: usize = 150;
/// Bytes of a point and of a colour.
const POINT_SIZE: usize = 24;
const COLOR_SIZE: usize = 16;
/// Parts of an arrow without points that are its shaft and its head.
const SHAFT: f64 = 0.77;
const HEAD: f64 = 0.23;

/// The definition of a marker.
#[derive(Clone, Copy, PartialEq)]
enum Edition {
    /// Without textures and embedded meshes, as in ROS 1.
    Foxy,
    Humble,
}

fn one(source: &mut Source<'_>, edition: Edition) -> Result<AnyMessage, Unusable> {
    let mut update = Update::default();
    update.add(Marker::read(source, edition)?, edition);
    Ok(update.done())
}

fn array(source: &mut Source<'_>, edition: Edition) -> Result<AnyMessage, Unusable> {
    let mut update = Update::default();
    for _ in 0..source.cursor.length(MARKER_SIZE)? {
        update.add(Marker::read(source, edition)?, edition);
    }
    Ok(update.done())
}

/// What the markers of one message do.
#[derive(Default)]
struct Update {
    deletions: Vec<SceneEntityDeletion>,
    /// `None` in place of one that was deleted or replaced.
    entities: Vec<Option<SceneEntity>>,
    /// Indices of the entities that are there, by namespace and number.
    indices: BTreeMap<(String, i32), usize>,
}

impl Update {
    fn add(&mut self, marker: Marker, edition: Edition) {
        let key = (marker.namespace.clone(), marker.id);
        let id = format!("{}/{}", marker.namespace, marker.id);
        match marker.action {
            // `ADD` and `MODIFY` are the same; 1 is out of use.
            0 | 1 => {
                let before = self.indices.insert(key, self.entities.len());
                self.leave_out(before);
                self.entities.push(Some(marker.into_entity(id)));
            }
            2 => {
                let before = self.indices.remove(&key);
                self.leave_out(before);
                self.delete(&marker.header, DeletionType::MatchingId.into(), id);
            }
            3 if edition == Edition::Humble && !marker.namespace.is_empty() => {
                let [first, last] = [i32::MIN, i32::MAX].map(|number| (marker.namespace.clone(), number));
                let own: Vec<_> = self.indices.range(first..=last).map(|(key, _)| key.clone()).collect();
                for key in own {
                    let before = self.indices.remove(&key);
                    self.leave_out(before);
                }
                self.delete(&marker.header, DELETES_NAMESPACE, marker.namespace);
            }
            3 => {
                self.entities.clear();
                self.indices.clear();
                self.delete(&marker.header, DeletionType::All.into(), String::new());
            }
            _ => {}
        }
    }

    fn leave_out(&mut self, index: Option<usize>) {
        if let Some(entity) = index.and_then(|index| self.entities.get_mut(index)) {
            *entity = None;
        }
    }

    fn delete(&mut self, header: &Header, kind: i32, id: String) {
        self.deletions.push(SceneEntityDeletion { timestamp: header.timestamp, r#type: kind, id });
    }

    fn done(self) -> AnyMessage {
        let entities = self.entities.into_iter().flatten().collect();
        AnyMessage::new(SceneUpdate { deletions: self.deletions, entities })
    }
}

/// A pose whose rotation has length 1, or is not finite.
#[derive(Clone, Copy)]
struct Place {
    rotation: DQuat,
    translation: DVec3,
}

impl Place {
    /// Four zeros are an orientation that was never set: none.
    fn of(pose: &Pose) -> Self {
        let (p, q) = (pose.position.unwrap_or_default(), pose.orientation.unwrap_or_default());
        let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
        let length = rotation.length();
        let rotation = if length == 0.0 {
            DQuat::IDENTITY
        } else if length.is_finite() {
            rotation.normalize()
        } else {
            rotation
        };
        Self { rotation, translation: DVec3::new(p.x, p.y, p.z) }
    }

    /// The pose with an origin and a rotation that are given in this one.
    fn at(&self, origin: DVec3, rotation: DQuat) -> Pose {
        let position = self.translation + self.rotation * origin;
        let rotation = self.rotation * rotation;
        let orientation = Quaternion { x: rotation.x, y: rotation.y, z: rotation.z, w: rotation.w };
        let position = Vector3 { x: position.x, y: position.y, z: position.z };
        Pose { position: Some(position), orientation: Some(orientation) }
    }
}

/// A `visualization_msgs/Marker`.
struct Marker {
    header: Header,
    namespace: String,
    id: i32,
    kind: i32,
    action: i32,
    place: Place,
    scale: Vector3,
    color: Color,
    /// Zero or less: for ever.
    lifetime: Duration,
    frame_locked: bool,
    points: Vec<Point3>,
    /// One for each point, or none.
    colors: Vec<Color>,
    text: String,
    mesh_url: String,
    mesh: Bytes,
    has_own_colors: bool,
}

impl Marker {
    fn read(source: &mut Source<'_>, edition: Edition) -> Result<Self, Unusable> {
        let header = source.header()?;
        let namespace = source.cursor.string()?;
        let (id, kind, action) = (source.cursor.i32()?, source.cursor.i32()?, source.cursor.i32()?);
        let (place, scale, color) = (Place::of(&source.pose()?), source.vector()?, color(source)?);
        let (seconds, nanos) = (source.cursor.i32()?, source.cursor.u32()?);
        let lifetime = Duration { seconds: seconds.into(), nanos: nanos.min(999_999_999) as i32 };
        let frame_locked = source.cursor.u8()? != 0;
        let count = source.cursor.length(POINT_SIZE)?;
        let points = (0..count).map(|_| point(source)).collect::<Result<Vec<_>, Unusable>>()?;
        let count = source.cursor.length(COLOR_SIZE)?;
        let colors = (0..count).map(|_| self::color(source)).collect::<Result<Vec<_>, Unusable>>()?;
        if edition == Edition::Humble {
            skip_texture(source)?;
        }
        let (text, mesh_url) = (source.cursor.string()?, source.cursor.string()?);
        let mesh = if edition == Edition::Humble {
            source.cursor.text()?;
            source.shared()?
        } else {
            Bytes::new()
        };
        let has_own_colors = source.cursor.u8()? != 0;
        let mut marker = Self {
            header,
            namespace,
            id,
            kind,
            action,
            place,
            scale,
            color,
            lifetime,
            frame_locked,
            points,
            colors,
            text,
            mesh_url,
            mesh,
            has_own_colors,
        };
        marker.match_colors();
        Ok(marker)
    }

    /// Makes the colours one for each point, or none. Many writers leave their opacity at 0: then that of the marker
    /// counts, if it has one.
    fn match_colors(&mut self) {
        let (points, colors) = (self.points.len(), self.colors.len());
        // Triangles may have a colour each.
        if self.kind == 11 && colors > 0 && colors * 3 == points {
            self.colors = self.colors.iter().flat_map(|color| [*color; 3]).collect();
        } else if colors != points {
            self.colors.clear();
        }
        if self.colors.iter().all(|color| color.a == 0.0) {
            let a = if self.color.a > 0.0 { self.color.a } else { 1.0 };
            self.colors.iter_mut().for_each(|color| color.a = a);
        }
    }

    fn into_entity(self, id: String) -> SceneEntity {
        let mut entity = SceneEntity {
            timestamp: self.header.timestamp,
            frame_id: self.header.frame_id.clone(),
            id,
            lifetime: Some(self.lifetime),
            frame_locked: self.frame_locked,
            ..SceneEntity::default()
        };
        let (pose, size, color) =
            (Some(self.place.at(DVec3::ZERO, DQuat::IDENTITY)), Some(self.scale), Some(self.color));
        match self.kind {
            0 => entity.arrows.extend(self.arrow()),
            1 => entity.cubes.push(CubePrimitive { pose, size, color }),
            2 => entity.spheres.push(SpherePrimitive { pose, size, color }),
            3 => {
                let (bottom_scale, top_scale) = (1.0, 1.0);
                entity.cylinders.push(CylinderPrimitive { pose, size, bottom_scale, top_scale, color });
            }
            4 => entity.lines.push(self.line(LineType::LineStrip, pose)),
            5 => entity.lines.push(self.line(LineType::LineList, pose)),
            6 => {
                let cube = |(pose, color)| CubePrimitive { pose, size, color };
                entity.cubes = self.listed().map(cube).collect();
            }
            7 => {
                let sphere = |(pose, color)| SpherePrimitive { pose, size, color };
                entity.spheres = self.listed().map(sphere).collect();
            }
            8 => {
                // RViz draws squares that face the camera, as wide and high as x and y say.
                let Vector3 { x, y, .. } = self.scale;
                let size = Some(Vector3 { x, y, z: x.min(y) });
                let cube = |(pose, color)| CubePrimitive { pose, size, color };
                entity.cubes = self.listed().map(cube).collect();
            }
            9 => entity.texts.push(TextPrimitive {
                pose,
                billboard: true,
                font_size: self.scale.z,
                scale_invariant: false,
                color,
                text: self.text.clone(),
            }),
            10 => entity.models.push(ModelPrimitive {
                pose,
                scale: size,
                color,
                override_color: !self.has_own_colors,
                url: self.mesh_url.clone(),
                media_type: String::new(),
                data: self.mesh.clone(),
            }),
            11 => entity.triangles.push(self.triangles(pose)),
            _ => {}
        }
        let left_out = self.points.len().saturating_sub(MOST_LISTED);
        if matches!(self.kind, 6..=8) && left_out > 0 {
            let (key, value) = ("points_left_out".to_owned(), left_out.to_string());
            entity.metadata.push(KeyValuePair { key, value });
        }
        entity
    }

    /// The pose and the colour of each point of a list.
    fn listed(&self) -> impl Iterator<Item = (Option<Pose>, Option<Color>)> + '_ {
        self.points.iter().take(MOST_LISTED).enumerate().map(|(index, point)| {
            let pose = self.place.at(DVec3::new(point.x, point.y, point.z), DQuat::IDENTITY);
            (Some(pose), Some(self.colors.get(index).copied().unwrap_or(self.color)))
        })
    }

    /// From the first point to the second, with diameters of shaft and head in x and y of the scale, and the length of the
    /// head in z; without points along x of the pose, with length, width and height in the scale.
    fn arrow(&self) -> Option<ArrowPrimitive> {
        let Vector3 { x, y, z } = self.scale;
        let color = Some(self.color);
        let [from, to, ..] = self.points.as_slice() else {
            return Some(ArrowPrimitive {
                pose: Some(self.place.at(DVec3::ZERO, DQuat::IDENTITY)),
                shaft_length: SHAFT * x,
                shaft_diameter: y,
                head_length: HEAD * x,
                head_diameter: 2.0 * y,
                color,
            });
        };
        let from = DVec3::new(from.x, from.y, from.z);
        let way = DVec3::new(to.x, to.y, to.z) - from;
        let length = way.length();
        if !(length.is_finite() && length > 0.0) {
            return None;
        }
        let head_length = if z > 0.0 { z.min(length) } else { HEAD * length };
        Some(ArrowPrimitive {
            pose: Some(self.place.at(from, DQuat::from_rotation_arc(DVec3::X, way / length))),
            shaft_length: length - head_length,
            shaft_diameter: x,
            head_length,
            head_diameter: y,
            color,
        })
    }

    fn line(&self, kind: LineType, pose: Option<Pose>) -> LinePrimitive {
        LinePrimitive {
            r#type: kind.into(),
            pose,
            thickness: self.scale.x,
            scale_invariant: false,
            points: self.points.clone(),
            color: Some(self.color),
            colors: self.colors.clone(),
            indices: Vec::new(),
        }
    }

    /// The corners are multiplied by the scale.
    fn triangles(&self, pose: Option<Pose>) -> TriangleListPrimitive {
        let Vector3 { x, y, z } = self.scale;
        let scaled = |p: &Point3| Point3 { x: p.x * x, y: p.y * y, z: p.z * z };
        TriangleListPrimitive {
            pose,
            points: self.points.iter().map(scaled).collect(),
            color: Some(self.color),
            colors: self.colors.clone(),
            indices: Vec::new(),
        }
    }
}

fn point(source: &mut Source<'_>) -> Result<Point3, Unusable> {
    let Vector3 { x, y, z } = source.vector()?;
    Ok(Point3 { x, y, z })
}

fn color(source: &mut Source<'_>) -> Result<Color, Unusable> {
    let (r, g) = (source.cursor.f32()?.into(), source.cursor.f32()?.into());
    let (b, a) = (source.cursor.f32()?.into(), source.cursor.f32()?.into());
    Ok(Color { r, g, b, a })
}

/// Textures are not drawn: the name, the image, and the places of the points in it.
fn skip_texture(source: &mut Source<'_>) -> Result<(), Unusable> {
    source.cursor.text()?;
    // A header whose time nobody reads: it may be anything.
    let (_, _) = (source.cursor.i32()?, source.cursor.u32()?);
    source.cursor.text()?;
    source.cursor.text()?;
    source.cursor.bytes()?;
    for _ in 0..source.cursor.length(8)? {
        let (_, _) = (source.cursor.f32()?, source.cursor.f32()?);
    }
    Ok(())
}
