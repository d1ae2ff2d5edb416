// Instances of points, lines and boxes, and triangles of surfaces: see shapes.rs and gpu.rs.

struct View {
    // From the shapes' own frame to clip coordinates.
    matrix: mat4x4<f32>,
    // Size of the picture, pixels.
    size: vec2<f32>,
    // Side of a point, and width of a line of one point, pixels.
    point: f32,
    line: f32,
};

@group(0) @binding(0) var<uniform> view: View;

struct Out {
    @builtin(position) at: vec4<f32>,
    @location(0) color: vec4<f32>,
};

@vertex
fn point(@builtin(vertex_index) v: u32, @location(0) p: vec3<f32>, @location(1) color: vec4<f32>) -> Out {
    let corner = vec2<f32>(f32(v & 1u), f32(v >> 1u)) * 2.0 - 1.0;
    var at = view.matrix * vec4<f32>(p, 1.0);
    at = vec4<f32>(at.xy + corner * view.point / view.size * at.w, at.zw);
    return Out(at, color);
}

@vertex
fn line(
    @builtin(vertex_index) v: u32,
    @location(0) from_p: vec3<f32>,
    @location(1) to_p: vec3<f32>,
    @location(2) color: vec4<f32>,
    @location(3) width: f32,
) -> Out {
    var a = view.matrix * vec4<f32>(from_p, 1.0);
    var b = view.matrix * vec4<f32>(to_p, 1.0);
    // The part behind the camera is cut off.
    let near = 1e-3;
    if a.w < near && b.w < near {
        return Out(vec4<f32>(0.0, 0.0, 2.0, 1.0), color);
    }
    if a.w < near {
        a = mix(a, b, (near - a.w) / (b.w - a.w));
    } else if b.w < near {
        b = mix(b, a, (near - b.w) / (a.w - b.w));
    }
    let way = (b.xy / b.w - a.xy / a.w) * view.size;
    let across = vec2<f32>(-way.y, way.x) / max(length(way), 1e-6);
    let side = f32(v >> 1u) * 2.0 - 1.0;
    var at = a;
    if (v & 1u) == 1u {
        at = b;
    }
    // Nearer by a little, so that a line on a surface is seen.
    let z = at.z - 0.0005 * at.w;
    at = vec4<f32>(at.xy + across * side * width * view.line / view.size * at.w, z, at.w);
    return Out(at, color);
}

@vertex
fn cell(
    @builtin(vertex_index) v: u32,
    @location(0) corner: vec3<f32>,
    @location(1) extent: vec3<f32>,
    @location(2) color: vec4<f32>,
) -> Out {
    let face = v / 6u;
    let k = v % 6u;
    let s = select(0.0, 1.0, k == 1u || k == 2u || k == 4u);
    let t = select(0.0, 1.0, k == 2u || k == 4u || k == 5u);
    var unit = vec3<f32>(s, t, 1.0);
    var shade = 1.0;
    if face == 1u {
        unit = vec3<f32>(s, 0.0, t);
        shade = 0.72;
    } else if face == 2u {
        unit = vec3<f32>(s, 1.0, t);
        shade = 0.84;
    } else if face == 3u {
        unit = vec3<f32>(0.0, s, t);
        shade = 0.62;
    } else if face == 4u {
        unit = vec3<f32>(1.0, s, t);
        shade = 0.78;
    }
    let at = view.matrix * vec4<f32>(corner + unit * extent, 1.0);
    return Out(at, vec4<f32>(color.rgb * shade, color.a));
}

@vertex
fn surface(@location(0) p: vec3<f32>, @location(1) color: vec4<f32>) -> Out {
    return Out(view.matrix * vec4<f32>(p, 1.0), color);
}

@fragment
fn paint(in: Out) -> @location(0) vec4<f32> {
    return in.color;
}
