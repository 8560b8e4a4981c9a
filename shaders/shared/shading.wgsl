// The definition of shading on the GPU. `scene/src/shading.rs` is the same on the CPU and documents the model. Positions
// are relative to the origin of the pass.

const PI: f32 = 3.14159265358979;

struct Light {
    position: vec3f,
    kind: u32, // 0 directional, 1 point, 2 spot
    direction: vec3f,
    range: f32, // 0: none
    color: vec3f,
    cos_inner: f32,
    cos_outer: f32,
    // Byte of a light visibility word that says which share of this light is seen.
    visibility_byte: u32,
    // Surfaces that are nearer to a point or spot light are lit as from this distance.
    nearest: f32,
}

struct Lighting {
    sky_zenith: vec3f,
    light_count: u32,
    sky_horizon: vec3f,
    exposure: f32,
    sky_ground: vec3f,
    // Factors of an environment map's irradiance, in xyz: `EnvironmentMap::ambient` in scene/src/environment.rs.
    sky_harmonics: array<vec4f, 9>,
}

struct Surface {
    position: vec3f,
    normal: vec3f,
    albedo: vec3f,
    emissive: vec3f,
    f0: vec3f,
    roughness: f32,
    // Share of light that is transmitted; 0 without reflection probes.
    transmitted: vec3f,
    // Unit normal of the triangle on the visible side, and the height above it at which rays to lights begin, metres. Zero
    // where surfaces are not lit by rays.
    side: vec3f,
    lift: f32,
}

// The sky is `environment_map`. Otherwise a texel is bound in its place and not read. Quirk: both-sides.
override has_environment: bool = false;

// All directions, equirectangular: scene/src/environment.rs.
@group(3) @binding(3) var environment_map: texture_2d<f32>;

// Radiance of the environment map from direction d (unit).
fn environment_radiance(d: vec3f) -> vec3f {
    let size = vec2i(textureDimensions(environment_map));
    let across = length(d.xz);
    // At the poles every column is right.
    let u = atan2(d.x, select(1.0, -d.z, across > 1e-20)) / (2.0 * PI);
    let v = atan2(across, d.y) / PI;
    let at = vec2f(u - floor(u), v) * vec2f(size) - 0.5;
    let first = floor(at);
    let left = (i32(first.x) + size.x) % size.x;
    let columns = vec2i(left, (left + 1) % size.x);
    let rows = clamp(vec2i(i32(first.y), i32(first.y) + 1), vec2i(0), vec2i(size.y - 1));
    let share = at - first;
    let upper = mix(
        textureLoad(environment_map, vec2i(columns.x, rows.x), 0).rgb,
        textureLoad(environment_map, vec2i(columns.y, rows.x), 0).rgb,
        share.x,
    );
    let lower = mix(
        textureLoad(environment_map, vec2i(columns.x, rows.y), 0).rgb,
        textureLoad(environment_map, vec2i(columns.y, rows.y), 0).rgb,
        share.x,
    );
    return mix(upper, lower, share.y);
}

// Irradiance of the environment map on a surface with unit normal n, divided by pi.
fn environment_ambient(lighting: Lighting, n: vec3f) -> vec3f {
    let linear = lighting.sky_harmonics[0] + lighting.sky_harmonics[1] * n.x + lighting.sky_harmonics[2] * n.y
        + lighting.sky_harmonics[3] * n.z;
    let products = lighting.sky_harmonics[4] * (n.x * n.y) + lighting.sky_harmonics[5] * (n.y * n.z)
        + lighting.sky_harmonics[6] * (n.x * n.z);
    let squares = lighting.sky_harmonics[7] * (3.0 * n.z * n.z - 1.0)
        + lighting.sky_harmonics[8] * (n.x * n.x - n.y * n.y);
    return max((linear + products + squares).rgb, vec3f(0.0));
}

// Radiance of the sky in direction d (unit).
fn sky_radiance(lighting: Lighting, d: vec3f) -> vec3f {
    if has_environment {
        return environment_radiance(d);
    }
    if d.y >= 0.0 {
        return mix(lighting.sky_horizon, lighting.sky_zenith, min(d.y, 1.0));
    }
    return mix(lighting.sky_horizon, lighting.sky_ground, min(-4.0 * d.y, 1.0));
}

// Irradiance of the sky on a surface with unit normal n, divided by pi.
fn sky_ambient(lighting: Lighting, n: vec3f) -> vec3f {
    if has_environment {
        return environment_ambient(lighting, n);
    }
    let upper = (lighting.sky_zenith + lighting.sky_horizon) * 0.5;
    return mix(lighting.sky_ground, upper, saturate(0.5 * n.y + 0.5));
}

struct Incident {
    to_light: vec3f,
    irradiance: vec3f,
}

// Irradiance from a light at a position, on a surface that faces it.
fn incident(light: Light, position: vec3f) -> Incident {
    if light.kind == 0u {
        return Incident(-light.direction, light.color);
    }
    let offset = light.position - position;
    let distance = length(offset);
    if !(distance > 0.0) {
        return Incident(vec3f(0.0, 1.0, 0.0), vec3f(0.0));
    }
    let to_light = offset / distance;
    let d = max(distance, light.nearest);
    var falloff = 1.0 / (d * d);
    if light.range > 0.0 {
        let x = d / light.range;
        falloff *= saturate(1.0 - x * x * x * x);
    }
    if light.kind == 2u {
        let ramp = saturate(
            (dot(-to_light, light.direction) - light.cos_outer) / max(light.cos_inner - light.cos_outer, 1e-4),
        );
        falloff *= ramp * ramp;
    }
    return Incident(to_light, light.color * falloff);
}

// Lambertian reflection of one light for unit albedo.
fn diffuse_light(light: Light, position: vec3f, normal: vec3f) -> vec3f {
    let arriving = incident(light, position);
    return arriving.irradiance * (max(dot(normal, arriving.to_light), 0.0) / PI);
}

fn ggx(alpha: f32, n_h: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = (n_h * a2 - n_h) * n_h + 1.0;
    return a2 / max(PI * d * d, 1e-12);
}

// Smith's height-correlated visibility, divided by 4 n.l n.v.
fn smith(alpha: f32, n_v: f32, n_l: f32) -> f32 {
    let a2 = alpha * alpha;
    let v = n_l * sqrt((n_v - n_v * a2) * n_v + a2);
    let l = n_v * sqrt((n_l - n_l * a2) * n_l + a2);
    return 0.5 / max(v + l, 1e-6);
}

// Karis' fit of the split-sum BRDF table.
fn environment_brdf(f0: vec3f, roughness: f32, n_v: f32) -> vec3f {
    let r = saturate(roughness);
    let x = 1.0 - r;
    let y = -0.0275 * r + 0.0425;
    let z = -0.572 * r + 1.04;
    let w = 0.022 * r - 0.04;
    let a004 = min(x * x, exp2(-9.28 * n_v)) * x + y;
    return f0 * (-1.04 * a004 + z) + vec3f(1.04 * a004 + w);
}

// Unit direction of mirror reflection for the unit direction to_eye.
fn reflected_direction(surface: Surface, to_eye: vec3f) -> vec3f {
    return 2.0 * dot(surface.normal, to_eye) * surface.normal - to_eye;
}

// Reflection of prefiltered radiance `incoming` on a glossy surface towards to_eye (split sum).
fn specular_of(surface: Surface, to_eye: vec3f, incoming: vec3f) -> vec3f {
    let n_v = max(dot(surface.normal, to_eye), 1e-3);
    return incoming * environment_brdf(surface.f0, surface.roughness, n_v);
}

// Reflection of the sky on a glossy surface towards the unit direction to_eye.
fn specular_sky(surface: Surface, to_eye: vec3f, lighting: Lighting) -> vec3f {
    let reflected = reflected_direction(surface, to_eye);
    let sky = mix(
        sky_radiance(lighting, reflected), sky_ambient(lighting, reflected), saturate(surface.roughness),
    );
    return specular_of(surface, to_eye, sky);
}

// Specular reflection of a light on a glossy surface towards the unit direction to_eye.
fn specular_light(surface: Surface, to_eye: vec3f, light: Light) -> vec3f {
    let arriving = incident(light, surface.position);
    let n_l = dot(surface.normal, arriving.to_light);
    if !(n_l > 0.0) {
        return vec3f(0.0);
    }
    let n_v = max(dot(surface.normal, to_eye), 1e-3);
    let alpha = max(surface.roughness * surface.roughness, 2e-3);
    let sum = arriving.to_light + to_eye;
    let len = length(sum);
    var h = surface.normal;
    if len > 1e-12 {
        h = sum / len;
    }
    let fresnel = surface.f0
        + (vec3f(1.0) - surface.f0) * pow(1.0 - saturate(dot(arriving.to_light, h)), 5.0);
    return arriving.irradiance
        * (n_l * ggx(alpha, saturate(dot(surface.normal, h))) * smith(alpha, n_v, n_l)) * fresnel;
}
