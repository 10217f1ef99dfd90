//! Makes the demo models, a torus and nine animals, from limbs and sheets of spheres:
//!
//! ```text
//! cargo run --release --example make_models [FOLDER]
//! ```
//!
//! An animal looks along +x with its feet down -y. Its right half (z >= 0) is built in any unit of length, then
//! [`Model::mirror`] adds the left half and [`Model::fit`] brings it to size, centred at the origin.

use std::collections::BTreeSet;
use std::{env, fs, io, path::Path};

use glam::{Vec3, Vec4, Vec4Swizzles};

/// A sphere: x, y, z, radius.
type Ball = [f32; 4];

/// Name, length of the longest side in metres, and how to build it.
type Entry = (&'static str, f32, fn() -> Model);

const MODELS: [Entry; 10] = [
    ("torus", 0.505, torus),
    ("deer", 1.0, deer),
    ("cow", 1.0, cow),
    ("armadillo", 1.0, armadillo),
    ("bear", 1.0, bear),
    ("bug", 1.0, bug),
    ("dolphin", 1.0, dolphin),
    ("spider", 1.0, spider),
    ("bunny", 1.0, bunny),
    ("dinosaur", 1.0, dinosaur),
];

fn main() -> io::Result<()> {
    let folder = env::args().nth(1).unwrap_or_else(|| "assets/models".into());
    fs::create_dir_all(&folder)?;
    for (name, size, build) in MODELS {
        let mut model = build();
        model.fit(size);
        model.check(name);
        let cones = model.bare_edges().len();
        println!("{name:10} {:3} spheres {cones:3} edges {:3} faces", model.balls.len(), model.faces.len());
        fs::write(Path::new(&folder).join(name).with_extension("ma"), model.to_ma())?;
    }
    Ok(())
}

/// A ring of spheres in the xz plane.
fn torus() -> Model {
    const SPHERES: usize = 26;
    let mut m = Model::default();
    let ring: Vec<Ball> = (0..SPHERES)
        .map(|i| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / SPHERES as f32).sin_cos();
            [0.2 * cos, 0.0, 0.2 * sin, 0.0525]
        })
        .collect();
    let ring = m.limb(1, &ring);
    m.join(ring[SPHERES - 1], ring[0]);
    m
}

fn deer() -> Model {
    let mut m = Model::default();
    let spine =
        m.limb(1, &[[-2.5, 5.5, 0., 0.75], [-1.0, 5.45, 0., 0.68], [0.5, 5.45, 0., 0.74], [1.7, 5.65, 0., 0.8]]);
    let flank =
        m.limb(1, &[[-2.2, 5.0, 0.35, 0.65], [-0.9, 4.9, 0.35, 0.6], [0.5, 4.7, 0.35, 0.7], [1.6, 4.9, 0.32, 0.7]]);
    m.sheet(&spine, &flank);
    m.grow(spine[0], 1, &[[-3.25, 5.85, 0., 0.26], [-3.6, 5.5, 0., 0.12]]);
    let thigh = m.grow(
        flank[0],
        1,
        &[[-2.3, 3.9, 0.5, 0.44], [-2.85, 2.6, 0.5, 0.22], [-2.7, 1.2, 0.5, 0.16], [-2.6, 0.2, 0.5, 0.2]],
    );
    m.sheet(&[thigh[1]], &flank[..2]);
    m.grow(
        flank[3],
        1,
        &[[1.75, 3.7, 0.45, 0.36], [1.7, 2.3, 0.45, 0.21], [1.75, 1.1, 0.45, 0.15], [1.8, 0.2, 0.45, 0.2]],
    );

    let neck = m.grow(spine[3], 2, &[[2.5, 6.9, 0., 0.52], [2.95, 8.4, 0., 0.46]]);
    m.sheet(&[flank[3]], &neck[..2]);
    let head = neck[4];
    let snout = m.grow(head, 1, &[[3.65, 8.15, 0., 0.33], [4.2, 7.9, 0., 0.23]]);
    m.eye(snout[2], [3.3, 8.5, 0.36, 0.11]);
    let ear = m.grow(head, 1, &[[2.75, 8.8, 0.38, 0.14]])[1];
    m.leaf(ear, &[[2.6, 9.15, 0.85, 0.1], [2.45, 9.2, 1.4, 0.05], [2.65, 8.8, 0.95, 0.1]]);
    let antler = m.grow(
        head,
        1,
        &[
            [3.0, 9.05, 0.28, 0.14],
            [2.65, 9.65, 0.75, 0.13],
            [2.2, 10.25, 1.25, 0.12],
            [2.0, 10.9, 1.6, 0.11],
            [2.25, 11.55, 1.65, 0.08],
            [2.7, 12.0, 1.45, 0.04],
        ],
    );
    m.grow(antler[1], 1, &[[3.55, 9.35, 0.5, 0.1], [3.95, 9.85, 0.5, 0.04]]);
    m.grow(antler[3], 1, &[[2.75, 10.5, 1.15, 0.09], [3.1, 11.05, 0.95, 0.04]]);
    m.grow(antler[4], 1, &[[1.55, 11.3, 1.8, 0.08], [1.35, 11.9, 1.8, 0.04]]);
    m.mirror();
    m.bridge(&flank);
    m
}

fn cow() -> Model {
    let mut m = Model::default();
    let spine = m.limb(
        1,
        &[
            [-3.2, 4.85, 0., 0.8],
            [-1.6, 4.95, 0., 0.85],
            [0.1, 4.9, 0., 0.9],
            [1.6, 5.0, 0., 0.9],
            [2.8, 5.2, 0., 0.85],
        ],
    );
    let flank = m.limb(
        1,
        &[
            [-3.0, 4.1, 0.7, 0.8],
            [-1.5, 3.55, 0.85, 0.9],
            [0.1, 3.35, 0.9, 0.95],
            [1.6, 3.45, 0.8, 0.9],
            [2.7, 4.0, 0.55, 0.8],
        ],
    );
    m.sheet(&spine, &flank);
    m.grow(
        spine[0],
        1,
        &[
            [-4.0, 5.25, 0., 0.16],
            [-4.35, 4.4, 0., 0.11],
            [-4.4, 3.2, 0., 0.1],
            [-4.4, 2.6, 0., 0.22],
            [-4.4, 2.1, 0., 0.1],
        ],
    );
    let thigh = m.grow(
        flank[0],
        1,
        &[[-3.0, 2.7, 0.85, 0.55], [-3.35, 1.6, 0.88, 0.3], [-3.2, 0.8, 0.88, 0.24], [-3.1, 0.28, 0.88, 0.3]],
    );
    m.sheet(&[thigh[1]], &flank[..2]);
    let arm = m.grow(
        flank[4],
        1,
        &[[2.5, 2.6, 0.7, 0.45], [2.45, 1.6, 0.72, 0.3], [2.4, 0.8, 0.72, 0.24], [2.5, 0.28, 0.72, 0.3]],
    );
    m.sheet(&[arm[1]], &flank[3..]);
    let udder = m.grow(flank[1], 1, &[[-1.85, 2.55, 0.22, 0.5]]);
    m.grow(udder[1], 1, &[[-1.65, 2.05, 0.35, 0.13]]);

    // The head is a wedge, wide at the brow and at the muzzle.
    let neck = m.grow(spine[4], 1, &[[3.7, 5.6, 0., 0.72]])[1];
    let face = m.limb(1, &[[4.4, 6.15, 0.26, 0.56], [5.05, 5.35, 0.2, 0.44], [5.5, 4.75, 0.26, 0.42]]);
    m.sheet(&[neck], &face[..2]);
    m.sheet(&[neck], &[spine[4], flank[4]]);
    m.eye(face[2], [4.85, 6.2, 0.62, 0.15]);
    let ear = m.grow(face[0], 1, &[[4.1, 6.3, 0.8, 0.16]])[1];
    m.leaf(ear, &[[4.05, 6.4, 1.35, 0.12], [4.05, 6.1, 1.8, 0.08], [4.1, 5.9, 1.3, 0.12]]);
    m.grow(
        face[0],
        1,
        &[[4.25, 6.75, 0.5, 0.18], [4.2, 7.0, 0.95, 0.15], [4.3, 7.4, 1.2, 0.11], [4.45, 7.85, 1.15, 0.04]],
    );
    m.mirror();
    m.bridge(&flank);
    m.bridge(&face);
    m
}

fn armadillo() -> Model {
    let mut m = Model::default();
    let core = m.limb(1, &[[-2.2, 1.75, 0., 0.85], [-0.8, 1.85, 0., 1.0], [0.6, 1.8, 0., 0.95], [1.7, 1.6, 0., 0.7]]);
    // The armour is made of arches over the back: shields of slabs fore and aft, loose bands between them.
    let mut arch = |x: f32, lean: f32, height: f32, width: f32, thickness: f32| {
        let half = [0.0_f32, 32.0, 64.0, 96.0].map(|degrees| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            [x - lean * (1.0 - cos), 1.45 + height * cos, width * sin, thickness]
        });
        m.limb(1, &half)
    };
    let rump = [arch(-3.15, -0.2, 0.4, 0.75, 0.25), arch(-2.6, -0.15, 1.1, 1.15, 0.27), arch(-1.7, 0.0, 1.5, 1.4, 0.3)];
    let bands = [-1.12, -0.54, 0.04, 0.62].map(|x| arch(x, 0.1, 1.6 - 0.06 * x * x, 1.45, 0.3));
    let shoulder = [arch(1.2, 0.2, 1.45, 1.35, 0.3), arch(2.05, 0.35, 1.0, 1.0, 0.26), arch(2.55, 0.4, 0.6, 0.7, 0.22)];
    for shield in [&rump, &shoulder] {
        m.sheet(&shield[0], &shield[1]);
        m.sheet(&shield[1], &shield[2]);
    }
    for (rim, inner) in
        [(&rump[2], 0), (&bands[0], 1), (&bands[1], 1), (&bands[2], 2), (&bands[3], 2), (&shoulder[0], 3)]
    {
        m.join(core[inner], rim[3]);
    }
    let head =
        m.grow(core[3], 1, &[[2.6, 1.55, 0., 0.5], [3.3, 1.45, 0., 0.5], [4.1, 1.1, 0., 0.27], [4.7, 0.85, 0., 0.15]]);
    m.eye(head[4], [3.55, 1.6, 0.36, 0.11]);
    let ear = m.grow(head[2], 1, &[[3.05, 1.9, 0.26, 0.13]])[1];
    m.leaf(ear, &[[2.8, 2.35, 0.22, 0.1], [2.75, 2.75, 0.45, 0.07], [2.9, 2.35, 0.62, 0.1]]);
    m.grow(core[0], 1, &[[-3.4, 1.25, 0., 0.42], [-4.2, 0.8, 0., 0.3], [-5.0, 0.5, 0., 0.2], [-5.8, 0.45, 0., 0.08]]);
    let thigh = m.grow(core[0], 1, &[[-2.1, 0.95, 0.85, 0.45], [-2.3, 0.35, 0.95, 0.28]])[2];
    m.leaf(thigh, &[[-1.75, 0.15, 0.75, 0.13], [-1.65, 0.15, 1.0, 0.13], [-1.75, 0.15, 1.25, 0.13]]);
    let arm = m.grow(core[3], 1, &[[1.7, 0.9, 0.7, 0.38], [1.65, 0.35, 0.8, 0.26]])[2];
    m.leaf(arm, &[[2.15, 0.15, 0.6, 0.13], [2.25, 0.15, 0.83, 0.13], [2.15, 0.15, 1.05, 0.13]]);
    m.mirror();
    m
}

fn bear() -> Model {
    let mut m = Model::default();
    let spine = m.limb(1, &[[-2.7, 3.5, 0., 1.1], [-1.1, 3.7, 0., 1.15], [0.5, 3.8, 0., 1.1], [1.8, 4.25, 0., 1.0]]);
    let flank =
        m.limb(1, &[[-2.5, 2.8, 0.65, 1.0], [-1.0, 2.5, 0.7, 1.15], [0.6, 2.55, 0.65, 1.1], [1.9, 3.1, 0.6, 1.0]]);
    m.sheet(&spine, &flank);
    m.grow(spine[0], 1, &[[-3.75, 3.8, 0., 0.3]]);
    let thigh = m.grow(flank[0], 1, &[[-2.5, 1.6, 1.0, 0.72], [-2.75, 0.55, 1.05, 0.5]]);
    m.sheet(&[thigh[1]], &flank[..2]);
    m.leaf(thigh[2], &[[-2.05, 0.35, 0.8, 0.3], [-2.05, 0.35, 1.3, 0.3]]);
    let arm = m.grow(flank[3], 1, &[[1.9, 1.6, 0.95, 0.64], [1.75, 0.55, 1.0, 0.5]]);
    m.sheet(&[arm[1]], &flank[2..]);
    m.leaf(arm[2], &[[2.45, 0.35, 0.75, 0.3], [2.45, 0.35, 1.25, 0.3]]);

    let neck = m.grow(spine[3], 1, &[[2.9, 4.25, 0., 0.9]])[1];
    m.sheet(&[neck], &[spine[3], flank[3]]);
    let head = m.grow(neck, 1, &[[3.9, 4.4, 0., 0.9]])[1];
    let cheek = m.grow(head, 1, &[[4.15, 4.0, 0.45, 0.52]])[1];
    let muzzle = m.grow(head, 1, &[[4.95, 4.0, 0., 0.42], [5.14, 4.2, 0., 0.3]]);
    m.sheet(&[cheek], &[head, muzzle[1]]);
    m.eye(muzzle[2], [4.55, 4.72, 0.42, 0.15]);
    let ear = m.grow(head, 1, &[[3.7, 4.95, 0.55, 0.22]])[1];
    m.leaf(ear, &[[3.65, 5.3, 0.52, 0.2], [3.65, 5.42, 0.8, 0.18], [3.65, 5.2, 1.0, 0.2], [3.65, 4.9, 0.9, 0.2]]);
    m.mirror();
    m.bridge(&flank);
    m
}

/// A stag beetle.
fn bug() -> Model {
    let mut m = Model::default();
    let core =
        m.limb(1, &[[-1.7, 0.95, 0., 0.5], [-0.4, 0.95, 0., 0.65], [0.8, 0.95, 0., 0.55], [1.5, 0.95, 0., 0.55]]);
    // Each wing case is a vaulted sheet; the two meet in a groove.
    let seam = m.limb(
        1,
        &[[-2.75, 0.8, 0.2, 0.2], [-1.95, 1.25, 0.24, 0.26], [-0.6, 1.55, 0.28, 0.3], [0.7, 1.35, 0.26, 0.28]],
    );
    let vault = m
        .limb(1, &[[-2.65, 0.78, 0.4, 0.2], [-1.85, 1.1, 0.75, 0.26], [-0.55, 1.35, 0.95, 0.3], [0.7, 1.2, 0.8, 0.28]]);
    let side = m
        .limb(1, &[[-2.45, 0.7, 0.6, 0.18], [-1.7, 0.75, 1.1, 0.22], [-0.5, 0.8, 1.35, 0.24], [0.7, 0.85, 1.15, 0.22]]);
    m.sheet(&seam, &vault);
    m.sheet(&vault, &side);
    m.join(core[1], side[2]);
    let collar = m.limb(1, &[[1.3, 1.05, 0.75, 0.4], [2.05, 0.98, 0.6, 0.34]]);
    m.sheet(&[core[3]], &collar);
    let head = m.grow(collar[1], 1, &[[2.65, 0.9, 0.38, 0.3]])[1];
    m.grow(head, 1, &[[2.65, 1.0, 0.72, 0.14]]);
    let jaw = m.grow(head, 2, &[[3.4, 0.95, 0.85, 0.16], [4.2, 1.1, 0.8, 0.13], [4.75, 1.2, 0.25, 0.05]]);
    m.grow(jaw[3], 1, &[[3.85, 1.05, 0.35, 0.05]]);
    m.grow(head, 1, &[[2.9, 1.25, 0.75, 0.07], [2.9, 1.6, 1.4, 0.06], [3.25, 1.6, 1.85, 0.12]]);
    let legs: [(usize, [Ball; 5]); 3] = [
        (
            3,
            [
                [1.5, 0.75, 0.7, 0.2],
                [2.0, 1.15, 1.5, 0.16],
                [2.5, 0.5, 1.95, 0.12],
                [2.8, 0.12, 2.15, 0.08],
                [3.15, 0.06, 2.3, 0.06],
            ],
        ),
        (
            2,
            [
                [0.5, 0.65, 0.9, 0.2],
                [0.35, 1.2, 1.9, 0.16],
                [0.1, 0.45, 2.5, 0.12],
                [0.0, 0.12, 2.8, 0.08],
                [-0.1, 0.06, 3.15, 0.06],
            ],
        ),
        (
            1,
            [
                [-0.6, 0.65, 0.9, 0.2],
                [-1.4, 1.2, 1.75, 0.16],
                [-2.1, 0.5, 2.25, 0.12],
                [-2.5, 0.12, 2.5, 0.08],
                [-2.9, 0.06, 2.7, 0.06],
            ],
        ),
    ];
    for (root, leg) in legs {
        m.grow(core[root], 1, &leg);
    }
    m.mirror();
    m.bridge(&collar);
    m.bridge(&[collar[1], head]);
    m
}

/// In a leap.
fn dolphin() -> Model {
    let mut m = Model::default();
    let back = m.limb(
        1,
        &[
            [3.35, 0.5, 0., 0.52],
            [2.3, 0.95, 0., 0.62],
            [1.1, 1.2, 0., 0.7],
            [-0.3, 1.1, 0., 0.65],
            [-1.6, 0.6, 0., 0.5],
            [-2.8, -0.2, 0., 0.32],
            [-3.6, -1.0, 0., 0.2],
            [-4.1, -1.7, 0., 0.16],
        ],
    );
    let belly = m.limb(
        1,
        &[
            [3.3, 0.2, 0.15, 0.46],
            [2.3, 0.25, 0.28, 0.62],
            [1.1, 0.4, 0.34, 0.7],
            [-0.3, 0.4, 0.26, 0.62],
            [-1.6, 0.15, 0.14, 0.45],
        ],
    );
    m.sheet(&back[..5], &belly);
    m.sheet(&[back[5]], &[back[4], belly[4]]);
    let beak = m.grow(back[0], 1, &[[4.15, -0.02, 0., 0.22], [4.8, -0.25, 0., 0.14]]);
    m.sheet(&[beak[1]], &[back[0], belly[0]]);
    m.eye(beak[2], [3.6, 0.25, 0.53, 0.09]);
    let base = m.limb(1, &[[1.0, 1.8, 0., 0.16], [-0.35, 1.65, 0., 0.14]]);
    m.join(back[2], base[0]);
    m.join(back[3], base[1]);
    let edge = m.limb(1, &[[0.55, 2.3, 0., 0.13], [-0.1, 2.7, 0., 0.1], [-0.85, 2.85, 0., 0.05]]);
    m.sheet(&base, &edge);
    m.leaf(
        back[7],
        &[[-4.15, -1.85, 0.7, 0.11], [-4.75, -2.2, 1.55, 0.04], [-4.7, -2.35, 0.8, 0.07], [-4.45, -2.15, 0.16, 0.08]],
    );
    let flipper = m.grow(belly[1], 1, &[[2.2, -0.1, 0.75, 0.22]])[1];
    m.leaf(
        flipper,
        &[[1.9, -0.6, 1.3, 0.13], [1.2, -1.05, 1.75, 0.05], [1.3, -0.6, 1.25, 0.1], [1.6, -0.15, 0.8, 0.12]],
    );
    m.mirror();
    m.bridge(&belly);
    m
}

fn spider() -> Model {
    let mut m = Model::default();
    let chest = m.limb(1, &[[0.4, 1.5, 0., 0.65], [1.3, 1.6, 0., 0.55]]);
    let abdomen = m.grow(
        chest[0],
        1,
        &[[-0.5, 1.7, 0., 0.25], [-1.3, 2.2, 0., 0.85], [-2.4, 2.45, 0., 0.95], [-3.3, 2.1, 0., 0.55]],
    );
    let side = m.limb(1, &[[-1.4, 1.95, 0.4, 0.75], [-2.3, 2.05, 0.45, 0.8]]);
    m.sheet(&abdomen[2..5], &side);
    m.grow(abdomen[4], 1, &[[-3.95, 1.75, 0.12, 0.12]]);
    let fang = m.grow(chest[1], 1, &[[1.85, 1.3, 0.2, 0.24], [2.0, 0.75, 0.14, 0.06]]);
    m.eye(fang[2], [1.78, 1.95, 0.17, 0.16]);
    m.grow(chest[1], 1, &[[1.55, 2.08, 0.42, 0.12]]);
    m.grow(chest[1], 1, &[[2.0, 1.45, 0.55, 0.14], [2.55, 1.6, 0.6, 0.12], [2.85, 1.1, 0.45, 0.1]]);
    // Distance from the middle of the chest, height, radius.
    let leg = [[0.75, 1.45, 0.21], [1.55, 2.85, 0.18], [2.5, 2.6, 0.16], [3.4, 1.2, 0.11], [3.9, 0.06, 0.06]];
    for (heading, stretch, root) in [(34.0_f32, 1.1, 1), (70.0, 0.95, 1), (106.0, 0.95, 0), (144.0, 1.15, 0)] {
        let (sin, cos) = heading.to_radians().sin_cos();
        let leg =
            leg.map(|[reach, height, radius]| [0.85 + reach * stretch * cos, height, reach * stretch * sin, radius]);
        m.grow(chest[root], 1, &leg);
    }
    m.mirror();
    m.bridge(&side);
    m
}

/// Sitting up.
fn bunny() -> Model {
    let mut m = Model::default();
    let spine = m.limb(1, &[[-1.3, 1.65, 0., 1.4], [-0.6, 2.15, 0., 1.35], [0.3, 2.5, 0., 1.15], [1.05, 3.0, 0., 0.9]]);
    let chest = m.limb(1, &[[-0.3, 1.35, 0.3, 1.1], [0.95, 1.9, 0.25, 0.85]]);
    m.sheet(&spine, &chest);
    let haunch = m.grow(spine[0], 1, &[[-0.75, 1.25, 0.9, 0.95], [-1.1, 0.42, 1.2, 0.4]]);
    // Like an eye, the tail is a bead on a stalk.
    m.grow(haunch[2], 1, &[[-1.2, 1.2, 0., 0.3], [-2.7, 1.6, 0., 0.58]]);
    m.leaf(haunch[2], &[[0.55, 0.28, 1.05, 0.26], [0.65, 0.28, 1.3, 0.26], [0.55, 0.28, 1.5, 0.26]]);
    m.sheet(&[haunch[1]], &[spine[0], chest[0]]);
    m.grow(chest[1], 1, &[[1.25, 1.2, 0.42, 0.42], [1.35, 0.6, 0.45, 0.3], [1.65, 0.28, 0.45, 0.26]]);

    let head = m.grow(spine[3], 1, &[[1.6, 4.0, 0., 1.0]])[1];
    let cheek = m.grow(head, 1, &[[2.1, 3.7, 0.45, 0.55]])[1];
    let muzzle = m.grow(head, 1, &[[2.5, 3.8, 0., 0.5], [2.74, 4.0, 0., 0.28]]);
    m.sheet(&[cheek], &[head, muzzle[1]]);
    m.eye(muzzle[2], [2.15, 4.4, 0.74, 0.19]);
    let inner = m.grow(
        head,
        1,
        &[
            [1.35, 4.85, 0.28, 0.24],
            [1.15, 5.6, 0.3, 0.22],
            [0.9, 6.4, 0.42, 0.19],
            [0.65, 7.15, 0.68, 0.15],
            [0.55, 7.5, 0.9, 0.12],
        ],
    );
    let outer =
        m.limb(1, &[[1.3, 4.85, 0.5, 0.24], [1.0, 5.6, 0.85, 0.22], [0.75, 6.4, 1.1, 0.19], [0.6, 7.0, 1.12, 0.15]]);
    m.sheet(&inner[1..], &outer);
    m.mirror();
    m.bridge(&chest);
    m
}

/// A stegosaur.
fn dinosaur() -> Model {
    let mut m = Model::default();
    let spine = m.limb(
        1,
        &[
            [3.7, 2.45, 0., 0.45],
            [2.5, 2.9, 0., 0.75],
            [1.0, 3.6, 0., 0.95],
            [-0.6, 3.95, 0., 1.0],
            [-2.0, 3.6, 0., 0.85],
            [-3.3, 3.0, 0., 0.58],
            [-4.5, 2.6, 0., 0.38],
            [-5.6, 2.45, 0., 0.22],
            [-6.5, 2.5, 0., 0.12],
        ],
    );
    let flank =
        m.limb(1, &[[2.3, 2.3, 0.4, 0.65], [0.9, 2.5, 0.6, 0.9], [-0.6, 2.75, 0.6, 0.95], [-1.7, 3.0, 0.45, 0.8]]);
    m.sheet(&spine[1..5], &flank);
    let thigh = m.grow(flank[2], 1, &[[-0.8, 1.9, 0.85, 0.62], [-1.0, 1.0, 0.9, 0.4], [-0.9, 0.4, 0.9, 0.36]]);
    m.sheet(&[thigh[1]], &flank[2..]);
    m.leaf(thigh[3], &[[-0.45, 0.26, 0.7, 0.22], [-0.45, 0.26, 1.1, 0.22]]);
    let arm = m.grow(flank[0], 1, &[[2.2, 1.6, 0.65, 0.42], [2.0, 0.9, 0.7, 0.3], [2.05, 0.36, 0.7, 0.3]]);
    m.leaf(arm[3], &[[2.4, 0.26, 0.55, 0.2], [2.4, 0.26, 0.85, 0.2]]);
    let head = m.grow(spine[0], 1, &[[4.5, 2.3, 0., 0.44], [5.15, 2.05, 0., 0.3], [5.6, 1.9, 0., 0.22]]);
    m.eye(head[3], [4.7, 2.5, 0.36, 0.12]);
    // Where on the spine, how tall.
    let plates = [(0.3, 0.6), (1.0, 0.85), (1.75, 1.2), (2.55, 1.5), (3.4, 1.4), (4.3, 1.05), (5.2, 0.7)];
    for (at, tall) in plates {
        let base = m.along(&spine, at);
        let ahead = (m.along(&spine, at - 0.1) - m.along(&spine, at + 0.1)).xyz().normalize();
        let up = Vec3::new(-ahead.y, ahead.x, 0.0);
        let corner = |rise: f32, shift: f32, radius: f32| {
            let p = base.xyz() + up * (base.w * 0.85 + rise * tall) + ahead * (shift * tall);
            [p.x, p.y, 0.16 + 0.22 * rise * tall, radius * tall.sqrt()]
        };
        let root = m.grow(spine[at.round() as usize], 1, &[corner(0.0, 0.0, 0.16)])[1];
        m.leaf(root, &[corner(0.5, -0.45, 0.08), corner(1.25, 0.0, 0.05), corner(0.5, 0.45, 0.08)]);
    }
    m.grow(spine[6], 1, &[[-4.7, 2.85, 0.3, 0.16], [-5.1, 3.35, 0.95, 0.04]]);
    m.grow(spine[7], 1, &[[-5.8, 2.6, 0.2, 0.14], [-6.2, 3.15, 0.85, 0.04]]);
    m.mirror();
    m.bridge(&flank);
    m
}

/// Spheres, the edges and the triangles that join them.
#[derive(Default)]
struct Model {
    balls: Vec<Vec4>,
    edges: BTreeSet<[usize; 2]>,
    faces: BTreeSet<[usize; 3]>,
    /// After [`Model::mirror`]: the sphere on the other side, per sphere.
    twins: Vec<usize>,
}

impl Model {
    /// A chain of cones along the smooth curve through `points`, with `steps` cones from each to the next.
    fn limb(&mut self, steps: usize, points: &[Ball]) -> Vec<usize> {
        self.balls.push(points[0].into());
        self.grow(self.balls.len() - 1, steps, &points[1..])
    }

    /// A [`limb`](Self::limb) from a sphere that is there already, the first of the returned chain.
    fn grow(&mut self, root: usize, steps: usize, points: &[Ball]) -> Vec<usize> {
        let through: Vec<Vec4> = [self.balls[root]].into_iter().chain(points.iter().map(|&ball| ball.into())).collect();
        let mut chain = vec![root];
        for cone in 1..=points.len() * steps {
            chain.push(self.balls.len());
            self.balls.push(curve(&through, cone as f32 / steps as f32));
            self.join(chain[cone - 1], chain[cone]);
        }
        chain
    }

    /// A bead on the right of a head. Its stalk starts in the middle of the head and is tied to `tip`, the small end
    /// of the snout: the cone from an eye straight to the large sphere that it sits on would be a bump.
    fn eye(&mut self, tip: usize, [x, y, z, radius]: Ball) {
        self.grow(tip, 1, &[[x, y, 0.0, radius * 0.8], [x, y, z, radius]]);
    }

    /// A fan of slabs from `root` to a new `rim`: ears, fins, plates, paws.
    fn leaf(&mut self, root: usize, rim: &[Ball]) {
        let rim = self.limb(1, rim);
        self.sheet(&[root], &rim);
    }

    /// A cone.
    fn join(&mut self, a: usize, b: usize) {
        self.edges.insert(sorted([a, b]));
    }

    /// A strip of slabs between two chains, whose spheres may differ in number.
    fn sheet(&mut self, a: &[usize], b: &[usize]) {
        let (mut i, mut j) = (0, 0);
        while i + 1 < a.len() || j + 1 < b.len() {
            let span =
                |k: Option<&usize>, l: usize| k.map_or(f32::INFINITY, |&k| self.center(k).distance(self.center(l)));
            let face = if span(a.get(i + 1), b[j]) <= span(b.get(j + 1), a[i]) {
                i += 1;
                [a[i - 1], a[i], b[j]]
            } else {
                j += 1;
                [a[i], b[j - 1], b[j]]
            };
            self.faces.insert(sorted(face));
        }
    }

    /// Adds the other side's copy of all that is not in the plane of symmetry.
    fn mirror(&mut self) {
        self.twins = (0..self.balls.len()).collect();
        for i in 0..self.balls.len() {
            if self.balls[i].z != 0.0 {
                self.twins[i] = self.balls.len();
                self.twins.push(i);
                self.balls.push(self.balls[i] * Vec4::new(1.0, 1.0, -1.0, 1.0));
            }
        }
        self.edges.extend(self.edges.clone().iter().map(|edge| sorted(edge.map(|i| self.twins[i]))));
        self.faces.extend(self.faces.clone().iter().map(|face| sorted(face.map(|i| self.twins[i]))));
    }

    /// A sheet from a chain to its mirror image.
    fn bridge(&mut self, chain: &[usize]) {
        let other: Vec<usize> = chain.iter().map(|&i| self.twins[i]).collect();
        self.sheet(chain, &other);
    }

    fn center(&self, i: usize) -> Vec3 {
        self.balls[i].xyz()
    }

    /// The sphere at `t` cones along a chain.
    fn along(&self, chain: &[usize], t: f32) -> Vec4 {
        let points: Vec<Vec4> = chain.iter().map(|&i| self.balls[i]).collect();
        curve(&points, t)
    }

    /// Centres the model and scales it so that its longest side is `size` metres.
    fn fit(&mut self, size: f32) {
        let bound =
            |side: f32| self.balls.iter().map(|b| (b.xyz() + side * b.w) * side).reduce(Vec3::max).unwrap_or_default();
        let (low, high) = (-bound(-1.0), bound(1.0));
        let scale = size / (high - low).max_element();
        for ball in &mut self.balls {
            *ball = (*ball - ((low + high) * 0.5).extend(0.0)) * scale;
        }
    }

    /// Panics unless the model is in one piece and each of its cones and slabs is a proper one.
    fn check(&self, name: &str) {
        let mut piece: Vec<usize> = (0..self.balls.len()).collect();
        for [a, b] in self.all_edges() {
            let (from, to) = (piece[a], piece[b]);
            piece.iter_mut().filter(|p| **p == from).for_each(|p| *p = to);
            let (distance, step) = (self.center(a).distance(self.center(b)), self.balls[a].w - self.balls[b].w);
            assert!(distance > step.abs(), "{name}: {} is inside of {}", self.balls[a], self.balls[b]);
        }
        assert!(piece.iter().all(|&p| p == piece[0]), "{name} falls apart");
        for face in &self.faces {
            // The gradient of the radius in the plane of the slab is less than 1: a plane touches all three spheres.
            let [a, b, c] = face.map(|i| self.balls[i]);
            let (e2, e3) = ((b - a).xyz(), (c - a).xyz());
            let area = e2.cross(e3);
            let gradient = (e3.cross(area) * (b.w - a.w) - e2.cross(area) * (c.w - a.w)) / area.length_squared();
            assert!(gradient.length() < 0.95, "{name}: degenerate slab {face:?}");
        }
    }

    fn all_edges(&self) -> BTreeSet<[usize; 2]> {
        self.edges.union(&self.face_sides()).copied().collect()
    }

    /// The cones that are not a side of a slab.
    fn bare_edges(&self) -> BTreeSet<[usize; 2]> {
        self.edges.difference(&self.face_sides()).copied().collect()
    }

    fn face_sides(&self) -> BTreeSet<[usize; 2]> {
        self.faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [a, c]]).collect()
    }

    /// The text of an `.ma` file.
    fn to_ma(&self) -> String {
        let edges = self.bare_edges();
        let mut text = format!("{} {} {}\n", self.balls.len(), edges.len(), self.faces.len());
        let balls = self.balls.iter().map(|b| format!("v {:.6} {:.6} {:.6} {:.6}\n", b.x, b.y, b.z, b.w));
        let edges = edges.iter().map(|[a, b]| format!("e {a} {b}\n"));
        let faces = self.faces.iter().map(|[a, b, c]| format!("f {a} {b} {c}\n"));
        text.extend(balls.chain(edges).chain(faces));
        text
    }
}

/// The Catmull-Rom curve through `points`, at `t` points from the first.
fn curve(points: &[Vec4], t: f32) -> Vec4 {
    let last = points.len() - 1;
    let from = (t as usize).min(last.saturating_sub(1));
    let t = t - from as f32;
    let (p1, p2) = (points[from], points[(from + 1).min(last)]);
    // Beyond the ends the curve goes straight on.
    let p0 = if from > 0 { points[from - 1] } else { p1 * 2.0 - p2 };
    let p3 = if from + 2 <= last { points[from + 2] } else { p2 * 2.0 - p1 };
    let (a, b, c) = (p2 - p0, p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3, p1 * 3.0 - p0 - p2 * 3.0 + p3);
    p1 + (a + (b + c * t) * t) * t * 0.5
}

fn sorted<const N: usize>(mut indices: [usize; N]) -> [usize; N] {
    indices.sort_unstable();
    indices
}
