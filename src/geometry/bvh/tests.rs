use super::*;
use crate::random::Random;

/// Boxes of mixed sizes at random places.
fn boxes(count: u32, seed: u32) -> Vec<Aabb> {
    let mut random = Random(seed.into());
    let mut point = || Vec3::from_array([(); 3].map(|()| random.unit()));
    (0..count)
        .map(|_| {
            let min = point() * 8.0;
            Aabb { min, max: min + point() * 4.0 }
        })
        .collect()
}

#[test]
fn visits_the_pairs_of_brute_force() {
    let mut found = 0;
    for count in [0, 1, 2, 3, 17, 200] {
        let items = boxes(count, count);
        let bvh = Bvh::new(&items);
        for query in boxes(50, 7) {
            let mut visited = Vec::new();
            bvh.overlapping(&query, |item| visited.push(item));
            let mut again = Vec::new();
            bvh.visit(|aabb| aabb.overlaps(&query), |item| again.push(item));
            assert_eq!(visited, again);
            visited.sort_unstable();
            let expected: Vec<u32> = (0..count).filter(|&i| items[i as usize].overlaps(&query)).collect();
            assert_eq!(visited, expected);
            found += expected.len();
        }
    }
    assert!(found > 500, "only {found} overlaps: the queries miss");
}

#[test]
fn the_least_item_is_the_one_of_brute_force() {
    let mut visited = 0;
    for count in [0, 1, 2, 3, 17, 200] {
        let items = boxes(count, count);
        let bvh = Bvh::new(&items);
        for query in boxes(50, 7) {
            let distance = |item: u32| items[item as usize].center().distance(query.min);
            let cost = |item: u32| {
                visited += 1;
                distance(item)
            };
            let found = bvh.least(|aabb| aabb.distance(query.min), cost).map(|(_, distance)| distance);
            assert_eq!(found, (0..count).map(distance).reduce(f32::min));
        }
    }
    assert!(visited < 50 * 223 / 2, "{visited} items visited: no box is skipped");
}

#[test]
fn visits_each_overlap_among_the_items_once() {
    let mut found = 0;
    for count in [0, 1, 2, 90] {
        let items = boxes(count, 5);
        let bvh = Bvh::new(&items);
        let mut visited = Vec::new();
        for leaf in bvh.leaves() {
            let item = bvh.item(leaf);
            bvh.overlapping_later(leaf, |other| visited.push((item.min(other), item.max(other))));
        }
        visited.sort_unstable();
        let all = (0..count).flat_map(|i| (i + 1..count).map(move |j| (i, j)));
        let expected: Vec<_> = all.filter(|&(i, j)| items[i as usize].overlaps(&items[j as usize])).collect();
        assert_eq!(visited, expected);
        found += expected.len();
    }
    assert!(found > 100, "only {found} overlaps");
}

#[test]
fn a_tree_is_updated_until_its_boxes_have_moved_far() {
    let (mut kept, mut built) = (0, 0);
    let (mut bvh, mut room) = (Bvh::default(), Vec::new());
    let mut items = boxes(100, 5);
    let velocities = boxes(100, 6);
    for _ in 0..40 {
        for (aabb, velocity) in items.iter_mut().zip(&velocities) {
            *aabb = aabb.swept((velocity.min - 4.0) * 0.05, [1.0, 1.0]);
        }
        let before: Vec<u32> = bvh.leaves().map(|leaf| bvh.item(leaf)).collect();
        bvh.update(&items, &mut room);
        let is_kept = bvh.leaves().map(|leaf| bvh.item(leaf)).eq(before);
        *if is_kept { &mut kept } else { &mut built } += 1;
        assert!(bvh.cost() <= 1.3 * Bvh::new(&items).cost(), "the search cost is too high");
        for query in boxes(20, 7) {
            let mut visited = Vec::new();
            bvh.overlapping(&query, |item| visited.push(item));
            visited.sort_unstable();
            assert_eq!(visited, Vec::from_iter((0..100).filter(|&i| items[i as usize].overlaps(&query))));
        }
    }
    assert!(kept > 20 && built > 3, "kept {kept} times, built {built} times");
    // The first tree has wide boxes, or one distant box that hides the cost of the others. It is rebuilt at once, or after `MOST_UPDATES`.
    const FAR: Aabb = Aabb { min: Vec3::splat(-1e6), max: Vec3::splat(-1e6) };
    let near_cost = |bvh: &Bvh| -> f32 {
        let near = bvh.nodes.iter().map(Node::aabb).filter(|aabb| aabb.min != FAR.min);
        near.map(|aabb| aabb.area()).sum()
    };
    let wide = items.iter().map(|aabb| aabb.inflated(50.0)).collect::<Vec<_>>();
    for (first, updates) in [(wide, 1), ([&[FAR], &items[1..]].concat(), MOST_UPDATES)] {
        bvh = Bvh::new(&first);
        let has_far = first[0] == FAR;
        for turn in 0..=updates {
            if turn == 1 {
                items.rotate_left(33);
            }
            let now = if has_far { [&[FAR], &items[1..]].concat() } else { items.clone() };
            bvh.update(&now, &mut room);
            let is_good = near_cost(&bvh) <= 1.3 * near_cost(&Bvh::new(&now));
            assert!(is_good || has_far && turn < updates, "after {turn} updates the search cost is too high");
        }
    }
    for count in [0, 1, 30] {
        bvh.update(&items[..count], &mut room);
        assert_eq!(bvh.leaves().count(), count);
    }
}

#[test]
fn visits_each_overlapping_pair_once() {
    let mut found = 0;
    for (count1, count2) in [(0, 5), (1, 1), (1, 90), (130, 1), (64, 65)] {
        let (items1, items2) = (boxes(count1, 3), boxes(count2, 4));
        let mut visited = Vec::new();
        let trees = [&items1, &items2].map(|items| Bvh::new(items));
        let merge = |a: &Aabb, b: &Aabb| a.merge(*b);
        let mut values = [Values::default(), Values::default()];
        trees[0].values(&trees[1].aabb(), Aabb::EMPTY, |i| items1[i as usize], merge, &mut values[0]);
        trees[1].values(&trees[0].aabb(), Aabb::EMPTY, |i| items2[i as usize], merge, &mut values[1]);
        let test = |i: usize, j: usize| values[0][i].overlaps(&values[1][j]);
        trees[0].visit_pairs(&trees[1], test, |i, j| visited.push((i, j)));
        visited.sort_unstable();
        let all = (0..count1).flat_map(|i| (0..count2).map(move |j| (i, j)));
        let expected: Vec<_> = all.filter(|&(i, j)| items1[i as usize].overlaps(&items2[j as usize])).collect();
        assert_eq!(visited, expected);
        found += expected.len();
    }
    assert!(found > 100, "only {found} overlaps");
}
