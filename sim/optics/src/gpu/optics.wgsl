// The image formation of `sensor.rs`, `elastomer.rs`, `shadows.rs` and `shading.rs` for many images at once.
//
// Every stage is one dispatch over all images: `smooth_columns` and `smooth_rows` for each kernel, then `cast_shadows`, then `expose`.
// A job is one image. Maps of different sizes are stored one after the other, each only as large as its rectangle.

// Words of one job: its header, then where each row of the image starts in the noise table.
const JOB: u32 = 256u;
const STARTS: u32 = 16u;
// Floats of a sensor's header, and of each lamp.
const HEADER: u32 = 32u;
const LAMP: u32 = 12u;
// Entries of a response table, number of cells, and radiance at the end of the table.
const RESPONSE: u32 = 1026u;
const CELLS: f32 = 1024.0;
const END: f32 = 4.0;
const NOISE: u32 = 66256u;
const SIDE: u32 = 240u;
const VALUES: u32 = 172800u;
// Pixels along a shadow cell's side.
const CELL: u32 = 2u;
const CELL_SIDE: u32 = 120u;

@group(0) @binding(0) var<storage, read> sensors: array<f32>;
@group(0) @binding(1) var<storage, read> jobs: array<u32>;
@group(0) @binding(2) var<storage, read> own: array<f32>;
@group(0) @binding(3) var<storage, read_write> depth: array<f32>;
@group(0) @binding(4) var<storage, read_write> share: array<f32>;
@group(0) @binding(5) var<storage, read_write> bytes: array<u32>;

// Index of the smoothing kernel.
override kernel: u32 = 0u;

struct Job {
    sensor: u32,
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    depth: u32,
    share: u32,
    lamps: u32,
}

fn job_at(n: u32) -> Job {
    let at = n * JOB;
    return Job(jobs[at], jobs[at + 1u], jobs[at + 2u], jobs[at + 3u], jobs[at + 4u], jobs[at + 5u], jobs[at + 6u],
        jobs[at + 7u]);
}

// ---- the gel ----

const LINES: u32 = 8u;
const SMOOTHERS: u32 = 128u;
var<workgroup> before: array<f32, 1920>;
var<workgroup> after: array<f32, 1920>;

// Three box filters of this radius along 8 lines of a job's map at once; beyond a border the border's value is repeated.
fn smooth_lines(thread: u32, base: u32, first: u32, lines: u32, places: u32, line_step: u32, place_step: u32, radius: i32) {
    let count = LINES * places;
    for (var i = thread; i < count; i += SMOOTHERS) {
        // Neighbouring threads read neighbouring memory.
        let line = select(i / places, i % LINES, line_step == 1u);
        let place = select(i % places, i / LINES, line_step == 1u);
        if first + line < lines {
            before[line * SIDE + place] = depth[base + (first + line) * line_step + place * place_step];
        }
    }
    workgroupBarrier();
    let scale = 1.0 / f32(2 * radius + 1);
    let last = i32(places) - 1;
    for (var pass_ = 0u; pass_ < 3u; pass_++) {
        for (var i = thread; i < count; i += SMOOTHERS) {
            let start = (i / places) * SIDE;
            let place = i32(i % places);
            var sum = 0.0;
            for (var k = place - radius; k <= place + radius; k++) {
                let at = start + u32(clamp(k, 0, last));
                sum += select(before[at], after[at], pass_ == 1u);
            }
            if pass_ == 1u {
                before[start + u32(place)] = sum * scale;
            } else {
                after[start + u32(place)] = sum * scale;
            }
        }
        workgroupBarrier();
    }
}

fn radius_of(sensor: u32, axis: u32) -> i32 {
    return i32(sensors[sensor + 14u + 2u * kernel + axis]);
}

@compute @workgroup_size(128)
fn smooth_columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = job_at(group.y);
    let first = group.x * LINES;
    if first >= job.width {
        return;
    }
    let radius = radius_of(job.sensor, 1u);
    if radius == 0 {
        return;
    }
    smooth_lines(thread, job.depth, first, job.width, job.height, 1u, job.width, radius);
    for (var i = thread; i < LINES * job.height; i += SMOOTHERS) {
        let line = i % LINES;
        let place = i / LINES;
        if first + line < job.width {
            depth[job.depth + first + line + place * job.width] = after[line * SIDE + place];
        }
    }
}

@compute @workgroup_size(128)
fn smooth_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = job_at(group.y);
    let first = group.x * LINES;
    if first >= job.height {
        return;
    }
    let radius = radius_of(job.sensor, 0u);
    if radius > 0 {
        smooth_lines(thread, job.depth, first, job.height, job.width, job.width, 1u, radius);
    }
    for (var i = thread; i < LINES * job.width; i += SMOOTHERS) {
        let line = i / job.width;
        let place = i % job.width;
        if first + line < job.height {
            let at = job.depth + (first + line) * job.width + place;
            // Without smoothing along the rows the columns' result is final.
            let softened = select(depth[at], after[line * SIDE + place], radius > 0);
            depth[at] = max(softened, own[at]);
        }
    }
}

// ---- cast shadows ----

// Largest tangent and its distance on the last three diagonals outwards from the lamp, for each quadrant around it.
const SHADERS: u32 = 128u;
var<workgroup> edge_tangent: array<f32, 1440>;
var<workgroup> edge_distance: array<f32, 1440>;

struct Grid {
    width: i32,
    height: i32,
    // First column and row beyond the lamp.
    start: vec2<i32>,
}

fn outwards(place: f32, count: i32) -> i32 {
    return min(i32(ceil(max(place, 0.0))), count);
}

// A cell's quadrant, and how many cells it is from the lamp along both axes.
fn quadrant(grid: Grid, column: i32, row: i32) -> vec3<u32> {
    let right = column >= grid.start.x;
    let below = row >= grid.start.y;
    let i = select(grid.start.x - 1 - column, column - grid.start.x, right);
    let j = select(grid.start.y - 1 - row, row - grid.start.y, below);
    return vec3<u32>(select(0u, 1u, right) + select(0u, 2u, below), u32(i), u32(j));
}

fn edge_slot(place: vec3<u32>) -> u32 {
    return (((place.y + place.z) % 3u) * 4u + place.x) * CELL_SIDE + place.z;
}

fn cell_depth(job: Job, column: u32, row: u32) -> f32 {
    let above = job.depth + CELL * row * job.width;
    let below = job.depth + min(CELL * row + 1u, job.height - 1u) * job.width;
    let left = CELL * column;
    let right = min(left + 1u, job.width - 1u);
    return 0.25 * ((depth[above + left] + depth[above + right]) + (depth[below + left] + depth[below + right]));
}

@compute @workgroup_size(128)
fn cast_shadows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = job_at(group.y);
    if group.x >= job.lamps || job.width == 0u {
        return;
    }
    let lamp = job.sensor + HEADER + group.x * LAMP;
    let width = i32((job.width + 1u) / CELL);
    let height = i32((job.height + 1u) / CELL);
    let pixel = vec2<f32>(sensors[job.sensor + 3u], sensors[job.sensor + 4u]);
    let size = 2.0 * pixel;
    // Middle of the first cell.
    let x0 = sensors[job.sensor + 5u] + (f32(job.left) + 0.5) * pixel.x;
    let y0 = sensors[job.sensor + 6u] - (f32(job.top) + 0.5) * pixel.y;
    let place = vec2<f32>((sensors[lamp] - x0) / size.x, (y0 - sensors[lamp + 1u]) / size.y);
    let lamp_depth = -sensors[lamp + 2u];
    let soft = 1.0 / max(sensors[lamp + 10u], 1e-6);
    let grid = Grid(width, height, vec2<i32>(outwards(place.x, width), outwards(place.y, height)));
    let out = job.share + group.x * u32(width * height);
    let longest = max(grid.start.x, width - grid.start.x) + max(grid.start.y, height - grid.start.y);
    for (var diagonal = 0; diagonal < longest; diagonal++) {
        for (var t = thread; t < 4u * CELL_SIDE; t += SHADERS) {
            let q = t / CELL_SIDE;
            let j = i32(t % CELL_SIDE);
            let i = diagonal - j;
            let column = select(grid.start.x - 1 - i, grid.start.x + i, (q & 1u) == 1u);
            let row = select(grid.start.y - 1 - j, grid.start.y + j, (q & 2u) == 2u);
            let columns = select(grid.start.x, width - grid.start.x, (q & 1u) == 1u);
            let rows = select(grid.start.y, height - grid.start.y, (q & 2u) == 2u);
            if i >= 0 && i < columns && j < rows {
                share[out + u32(row * width + column)] =
                    visit(job, grid, column, row, place - vec2<f32>(f32(column), f32(row)), size, lamp_depth, soft);
            }
        }
        workgroupBarrier();
    }
}

// Propagates the horizon to a cell; gives the visible share of the lamp. `to_lamp` is in cells.
fn visit(job: Job, grid: Grid, column: i32, row: i32, to_lamp: vec2<f32>, size: vec2<f32>, lamp_depth: f32, soft: f32) -> f32 {
    let slot = edge_slot(quadrant(grid, column, row));
    let metres = to_lamp * size;
    let distance = sqrt(max(dot(metres, metres), 1e-14));
    let tangent = (cell_depth(job, u32(column), u32(row)) - lamp_depth) / distance;
    let steps = max(abs(to_lamp.x), abs(to_lamp.y));
    edge_tangent[slot] = tangent;
    edge_distance[slot] = distance;
    if steps <= 1.0 {
        return 1.0;
    }
    let inverse = 1.0 / steps;
    let step = to_lamp * inverse;
    let near = distance * (1.0 - inverse);
    let beyond = vec2<f32>(-lamp_depth / near, near);
    let side = vec2<i32>(select(-1, 1, step.x >= 0.0), select(-1, 1, step.y >= 0.0));
    var a: vec2<f32>;
    var b: vec2<f32>;
    var part: f32;
    if abs(to_lamp.x) >= abs(to_lamp.y) {
        part = select(abs(step.y), 0.0, abs(to_lamp.y) < 1.0);
        a = edge_at(grid, column + side.x, row, beyond);
        b = a;
        if part > 0.0 {
            b = edge_at(grid, column + side.x, row + side.y, beyond);
        }
    } else {
        part = abs(step.x);
        a = edge_at(grid, column, row + side.y, beyond);
        b = edge_at(grid, column + side.x, row + side.y, beyond);
    }
    let highest = a.x + part * (b.x - a.x);
    let met = min(a.y + part * (b.y - a.y), near);
    if tangent < highest {
        edge_tangent[slot] = highest;
        edge_distance[slot] = met;
    }
    let reach = (tangent - highest) * distance * met * soft;
    let gap = distance - met;
    if reach >= gap {
        return 1.0;
    }
    let seen = 0.5 * (max(reach / gap, -1.0) + 1.0);
    return seen * seen * (3.0 - 2.0 * seen);
}

fn edge_at(grid: Grid, column: i32, row: i32, beyond: vec2<f32>) -> vec2<f32> {
    if column < 0 || row < 0 || column >= grid.width || row >= grid.height {
        return beyond;
    }
    let slot = edge_slot(quadrant(grid, column, row));
    return vec2<f32>(edge_tangent[slot], edge_distance[slot]);
}

// ---- shading and exposure ----

fn gel(job: Job, column: u32, row: u32) -> f32 {
    return depth[job.depth + row * job.width + column];
}

// Lower cell, upper cell, and the interpolation weight of a pixel between them.
fn between(pixel: u32, count: u32) -> vec3<f32> {
    let at = clamp((f32(pixel) - 0.5) / 2.0, 0.0, f32(count - 1u));
    let cell = min(u32(at), max(count, 2u) - 2u);
    return vec3<f32>(f32(cell), f32(min(cell + 1u, count - 1u)), at - f32(cell));
}

fn seen_of(job: Job, lamp: u32, column: u32, row: u32) -> f32 {
    let width = (job.width + 1u) / CELL;
    let height = (job.height + 1u) / CELL;
    let across = between(column, width);
    let down = between(row, height);
    let above = job.share + lamp * width * height + u32(down.x) * width;
    let below = job.share + lamp * width * height + u32(down.y) * width;
    let top = mix(share[above + u32(across.x)], share[above + u32(across.y)], across.z);
    let bottom = mix(share[below + u32(across.x)], share[below + u32(across.y)], across.z);
    return mix(top, bottom, down.z);
}

fn response(sensor: u32, channel: u32, radiance: f32) -> f32 {
    let at = clamp(radiance * (CELLS / END), 0.0, CELLS);
    let cell = u32(at);
    let table = sensor + HEADER + u32(sensors[sensor + 12u]) * LAMP + channel * RESPONSE + cell;
    return sensors[table] + (at - f32(cell)) * (sensors[table + 1u] - sensors[table]);
}

// Radiance of a pixel of the deformed gel, column and row counted in its rectangle.
fn radiance(job: Job, column: u32, row: u32, shadows: bool) -> vec3<f32> {
    let s = job.sensor;
    let pixel = vec2<f32>(sensors[s + 3u], sensors[s + 4u]);
    let left = select(column - 1u, 0u, column == 0u);
    let right = min(column + 1u, job.width - 1u);
    let above = select(row - 1u, 0u, row == 0u);
    let below = min(row + 1u, job.height - 1u);
    var slope = vec2<f32>(0.0);
    if right > left {
        slope.x = (gel(job, left, row) - gel(job, right, row)) / (f32(right - left) * pixel.x);
    }
    let rows = select(2.0, 1.0, row == 0u || row + 1u == job.height);
    slope.y = (gel(job, column, below) - gel(job, column, above)) / (rows * pixel.y);
    let normal = normalize(vec3<f32>(slope, -1.0));
    let point = vec3<f32>(sensors[s + 5u] + f32(job.left + column) * pixel.x,
        sensors[s + 6u] - f32(job.top + row) * pixel.y, -gel(job, column, row));
    let viewer = normalize(vec3<f32>(sensors[s], sensors[s + 1u], sensors[s + 2u]) - point);
    let cos_r = dot(normal, viewer);
    let ambient = vec3<f32>(sensors[s + 9u], sensors[s + 10u], sensors[s + 11u]);
    var sum = ambient * 0.5 * (1.0 - normal.z);
    for (var k = 0u; k < job.lamps; k++) {
        let lamp = s + HEADER + k * LAMP;
        let to_lamp = vec3<f32>(sensors[lamp], sensors[lamp + 1u], sensors[lamp + 2u]) - point;
        let inverse_square = 1.0 / dot(to_lamp, to_lamp);
        let light = to_lamp * sqrt(inverse_square);
        let along = -dot(light, vec3<f32>(sensors[lamp + 3u], sensors[lamp + 4u], sensors[lamp + 5u]));
        let cos_i = max(dot(normal, light), 0.0);
        if along > 0.0 && cos_i > 0.0 {
            let across = max(dot(light, viewer) - cos_i * cos_r, 0.0);
            let rough = sensors[s + 7u] + sensors[s + 8u] * across / max(max(cos_i, cos_r), 1e-3);
            var power = pow(max(along, 1e-6), sensors[lamp + 6u]) * inverse_square * cos_i * rough;
            if shadows {
                power *= seen_of(job, k, column, row);
            }
            sum += power * vec3<f32>(sensors[lamp + 7u], sensors[lamp + 8u], sensors[lamp + 9u]);
        }
    }
    return sum;
}

// Four pixels per thread: their twelve bytes are three words.
@compute @workgroup_size(64)
fn expose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = job_at(group.y);
    let row = group.x;
    if thread >= SIDE / 4u {
        return;
    }
    let noise = job.sensor + HEADER + u32(sensors[job.sensor + 12u]) * LAMP + 3u * RESPONSE;
    let draws = noise + jobs[group.y * JOB + STARTS + row];
    let background = noise + NOISE;
    let correction = background + VALUES;
    let shadows = jobs[group.y * JOB + 8u] != 0u;
    let brightness = bitcast<f32>(jobs[group.y * JOB + 9u]);
    var words = array<u32, 3>(0u, 0u, 0u);
    for (var i = 0u; i < 4u; i++) {
        let column = 4u * thread + i;
        let at = 3u * (row * SIDE + column);
        var grey = vec3<f32>(sensors[background + at], sensors[background + at + 1u], sensors[background + at + 2u]);
        if column >= job.left && column < job.left + job.width && row >= job.top && row < job.top + job.height {
            let light = radiance(job, column - job.left, row - job.top, shadows);
            for (var c = 0u; c < 3u; c++) {
                grey[c] = response(job.sensor, c, light[c] + sensors[correction + at + c]);
            }
        }
        for (var c = 0u; c < 3u; c++) {
            let value = u32(clamp(grey[c] * brightness + sensors[draws + 3u * column + c] + 0.5, 0.0, 255.0));
            let byte = 3u * i + c;
            words[byte / 4u] |= value << (8u * (byte % 4u));
        }
    }
    let out = group.y * (VALUES / 4u) + row * (3u * SIDE / 4u) + 3u * thread;
    bytes[out] = words[0];
    bytes[out + 1u] = words[1];
    bytes[out + 2u] = words[2];
}
