use super::*;
use crate::random::Random;

fn chain() -> MedialLevels {
    let levels = [16, 8, 4].map(|segments| {
        let deviation = Deviation { max: 8.0 / segments as f32, mean: 0.1 };
        let error = TwoSidedError { mesh_to_envelope: deviation, envelope_to_mesh: deviation, diagonal: 3.0 };
        Level { axis: MedialAxis::torus(1.0, 0.2, segments).unwrap(), error }
    });
    MedialLevels { levels: levels.into(), ..MedialLevels::default() }
}

/// The same chain with three joints.
fn skinned_chain() -> MedialLevels {
    let joints: Arc<[SkinJoint]> = (0..3)
        .map(|i| SkinJoint { name: format!("joint {i}"), inverse_bind: Affine3A::from_translation(Vec3::X * i as f32) })
        .collect();
    let mut random = Random(5);
    let mut levels = chain();
    for level in &mut levels.levels {
        let weights: Vec<JointWeights> =
            (0..level.axis.spheres().len()).map(|_| std::array::from_fn(|at| (at as u16 % 3, random.unit()))).collect();
        level.axis = level.axis.clone().with_skin(Skin::new(joints.clone(), &weights).unwrap()).unwrap();
    }
    levels
}

/// Bytes with a matching checksum.
fn sealed(version: u16, body: &[u8]) -> Vec<u8> {
    let head = MAGIC.into_iter().chain(version.to_le_bytes()).chain(crc32fast::hash(body).to_le_bytes());
    head.chain(body.iter().copied()).collect()
}

#[test]
fn levels_survive_a_round_trip() {
    let solid = |mut chain: MedialLevels| {
        chain.mass =
            Some(MedialAxis::cone(Sphere::new(Vec3::X, 0.3), Sphere::new(Vec3::Y, 0.5)).unwrap().mass().to_owned());
        chain.sides = SideLimits { inside: Some(0.5), enclose: None };
        chain
    };
    for (chain, version, has_skin) in [
        (chain(), RIGID, false),
        (skinned_chain(), SKINNED, true),
        (solid(chain()), SOLID, false),
        (solid(skinned_chain()), SOLID, true),
    ] {
        let bytes = chain.to_bytes();
        assert_eq!(bytes[6..8], version.to_le_bytes());
        let again = MedialLevels::from_bytes(&bytes).unwrap();
        assert_eq!((again.levels.len(), again.mass, again.sides), (3, chain.mass, chain.sides));
        for (a, b) in chain.levels.iter().zip(&again.levels) {
            let lists = |level: &Level| (level.axis.spheres().to_vec(), level.axis.primitives().to_vec(), level.error);
            assert_eq!(lists(a), lists(b));
            assert_eq!((a.axis.skin(), a.axis.skin().is_some()), (b.axis.skin(), has_skin));
        }
        let joints = again.levels.iter().filter_map(|level| level.axis.skin()).map(Skin::joints);
        assert!(
            joints.collect::<Vec<_>>().array_windows().all(|[a, b]| Arc::ptr_eq(a, b)),
            "levels share their joints"
        );
        let axis = again.into_medial_axis().unwrap();
        assert_eq!(axis.level(2).skin().is_some(), has_skin);
        let mass = chain.mass.unwrap_or(*chain.levels[0].axis.mass());
        assert!((0..3).all(|level| *axis.level(level).mass() == mass), "all levels have the mass of the solid");
    }
    let mut mixed = skinned_chain();
    mixed.levels.extend(chain().levels);
    assert_eq!(mixed.to_bytes()[6..8], RIGID.to_le_bytes(), "a level without a skin");
}

#[test]
fn errors_of_skins_name_level_and_sphere() {
    let good = || StoredSkin::of(&skinned_chain().levels).unwrap();
    let error = |change: &dyn Fn(&mut StoredSkin)| {
        let mut skin = good();
        change(&mut skin);
        let rigid = chain().to_bytes();
        let body = [&rigid[HEADER..], &postcard::to_allocvec(&skin).unwrap()].concat();
        MedialLevels::from_bytes(&sealed(SKINNED, &body)).map_or_else(|error| error.to_string(), |_| "none".into())
    };
    assert_eq!(error(&|_| {}), "none");
    let cases: [(&dyn Fn(&mut StoredSkin), &str); 8] = [
        (&|skin| drop(skin.weights.pop()), "it is damaged: it has no weights for some level; copy or build it again"),
        (
            &|skin| drop(skin.weights[1].pop()),
            "level 1: the skin has weights for 7 points, the mesh has 8; build it again",
        ),
        (
            &|skin| skin.weights[2][3] = vec![(0, 0.2); 5],
            "it is damaged: a sphere has more than four weights; copy or build it again",
        ),
        (
            &|skin| skin.weights[1][2].clear(),
            "level 1: point 2: all of its weights are 0; assign it to a joint; build it again",
        ),
        (&|skin| skin.weights[0][4][1].0 = 3, "level 0: point 4: there is no joint 3 among 3; build it again"),
        (&|skin| skin.joints.clear(), "level 0: the skin has no joints; build it again"),
        (
            &|skin| skin.joints[2].1[0] = f32::NAN,
            "level 0: joint 2 `joint 2`: its inverse bind pose is not finite or not invertible; export the skin again; build it again",
        ),
        (
            &|skin| skin.joints[1].0 = "joint 0".into(),
            "level 0: joints 0 and 1 are both named `joint 0`; rename one of them; build it again",
        ),
    ];
    for (change, message) in cases {
        assert_eq!(error(change), message);
    }
    let bytes = skinned_chain().to_bytes();
    let cut = "it is damaged: the lists do not have the expected length; copy or build it again";
    let without_end = MedialLevels::from_bytes(&sealed(SKINNED, &bytes[HEADER..bytes.len() - 1])).unwrap_err();
    assert_eq!(without_end.to_string(), cut);
    let rigid = MedialLevels::from_bytes(&sealed(RIGID, &bytes[HEADER..])).unwrap_err();
    assert_eq!(rigid.to_string(), "it is damaged: bytes follow the last level; copy or build it again");
}

#[test]
fn the_coarsest_level_within_a_budget_is_found() {
    let chain = chain();
    for (percent, spheres) in [(0.1, 16), (0.5, 16), (1.0, 8), (1.9, 8), (2.0, 4), (50.0, 4)] {
        assert_eq!(chain.coarsest_within(percent).unwrap().axis.spheres().len(), spheres, "{percent} %");
    }
    assert!(MedialLevels::default().coarsest_within(1.0).is_none());
}

#[test]
fn errors_name_cause_and_remedy() {
    let error = |bytes: &[u8]| MedialLevels::from_bytes(bytes).unwrap_err().to_string();
    let good = chain().to_bytes();
    let no_file = "it is not a .medial file; write one with `medial build --levels`";
    assert_eq!((error(b""), error(b"2 1 0\nv 0 0 0 1\n")), (no_file.into(), no_file.into()));
    let mut newer = good.clone();
    newer[6] = 4;
    assert_eq!(error(&newer), "it has version 4 of the format, not 1 to 3; build it again");
    let damaged = "it is damaged: the checksum does not match; copy or build it again";
    assert_eq!(error(&good[..good.len() - 1]), damaged);
    assert_eq!(
        error(&sealed(RIGID, &[])),
        "it is damaged: the lists do not have the expected length; copy or build it again"
    );
    let more: Vec<u8> = good[HEADER..].iter().copied().chain([0]).collect();
    assert_eq!(error(&sealed(RIGID, &more)), "it is damaged: bytes follow the last level; copy or build it again");
    assert_eq!(error(&sealed(RIGID, &[0])), "it has no levels; build it again");
    let stored = |cones| Stored { spheres: vec![[0.0, 0.0, 0.0, 1.0]], cones, slabs: vec![], error: [0.0; 5] };
    let wild = postcard::to_allocvec(&vec![stored(vec![]), stored(vec![[0, 7]])]).unwrap();
    assert_eq!(error(&sealed(RIGID, &wild)), "level 1: primitive 0: there is no sphere 7 among 1; build it again");
    let no_solid =
        MedialLevels { mass: Some(MassProperties { volume: 0.0, ..*chain().levels[0].axis.mass() }), ..chain() };
    let no_mass = "it is damaged: its mass properties are not those of a solid; copy or build it again";
    assert_eq!(error(&no_solid.to_bytes()), no_mass);
    let missing = MedialLevels::load(Path::new("no such.medial")).unwrap_err().to_string();
    assert!(missing.starts_with("no such.medial: "), "{missing}");
}

#[test]
fn damage_never_passes_for_a_shape() {
    let solid = MedialLevels { mass: Some(*MedialAxis::sphere(1.0).unwrap().mass()), ..skinned_chain() };
    for (chain, version) in [(chain(), RIGID), (skinned_chain(), SKINNED), (solid, SOLID)] {
        let good = chain.to_bytes();
        damage_never_passes(&good, version);
    }
}

fn damage_never_passes(good: &[u8], version: u16) {
    let mut random = Random(3);
    let mut passed = 0;
    for round in 0..2000 {
        let mut bytes = good.to_vec();
        let at = random.below(bytes.len());
        match round % 3 {
            0 => bytes.truncate(at),
            1 => bytes[at] ^= 1 << random.below(8),
            _ => drop(bytes.drain(at..bytes.len().min(at + 1 + random.below(9)))),
        }
        assert!(MedialLevels::from_bytes(&bytes).is_err(), "round {round}");
        // With a matching checksum, the same bytes must not cause a panic or an allocation beyond their size.
        if round % 20 == 0 {
            let body = bytes.get(HEADER..).unwrap_or_default();
            passed += usize::from(MedialLevels::from_bytes(&sealed(version, body)).is_ok());
        }
    }
    assert!(passed > 10, "only {passed} have passed the checksum");
}
