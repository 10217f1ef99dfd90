//! The nearest spheres of two primitives by a fixed sequence of operations without branches, so that many pairs run in SIMD lanes.

use super::{
    nearest::{Edge, Face},
    number::{Ball, Number, Vector},
    separation::edges,
};

/// Upper bound of the distance of two primitives, a direction from the first to the second at that distance, and the weights of the two spheres.
#[inline(always)]
pub(super) fn nearest<R: Number, const N: usize, const M: usize>(
    first: &[Ball<R>; N],
    second: &[Ball<R>; M],
) -> Nearest<R, N, M> {
    let apart = second[0].center - first[0].center;
    let (zero, one) = (apart.x.like(0.0), apart.x.like(1.0));
    let (infinity, weights) = (zero.like(f32::INFINITY), (at_vertex(0, zero), at_vertex(0, zero)));
    let mut best = Nearest { upper: infinity, normal: apart, weights };
    if N == 1 && M == 1 {
        best.take(apart.length() - first[0].radius - second[0].radius, apart, weights);
    }
    let edges1: [Edge<R>; N] = each(
        #[inline(always)]
        |i| Edge::new(first[i], first[(i + 1) % N]),
    );
    let edges2: [Edge<R>; M] = each(
        #[inline(always)]
        |i| Edge::new(second[i], second[(i + 1) % M]),
    );
    // With a cone, the two facing ends of each pair of edges are less work than all ends. Two slabs have nine pairs of edges, so all ends are less work.
    let facing = N.min(M) == 2;
    if !facing {
        for (i, ball) in first.iter().enumerate() {
            for (j, edge) in edges2[..edges(M)].iter().enumerate() {
                let (gap, normal, t) = edge.gap(ball.center);
                best.take(gap - ball.radius, -normal, (at_vertex(i, zero), on_edge(j, t)));
            }
        }
        for (j, ball) in second.iter().enumerate() {
            for (i, edge) in edges1[..edges(N)].iter().enumerate() {
                let (gap, normal, s) = edge.gap(ball.center);
                best.take(gap - ball.radius, normal, (on_edge(i, s), at_vertex(j, zero)));
            }
        }
    }
    for (i, edge1) in edges1[..edges(N)].iter().enumerate() {
        for (j, edge2) in edges2[..edges(M)].iter().enumerate() {
            let crossing = edge1.crossing(edge2);
            let (gap, normal, inside) = crossing.gap(edge1, edge2);
            best.take_if(inside, gap, -normal, (on_edge(i, crossing.s), on_edge(j, crossing.t)));
            if facing {
                let [late1, late2] = crossing.facing(edge1, edge2);
                let ball1 = Ball::select(late1, first[(i + 1) % N], first[i]);
                let ball2 = Ball::select(late2, second[(j + 1) % M], second[j]);
                let (s, t) = (R::select(late1, one, zero), R::select(late2, one, zero));
                let (gap, normal, nearest) = edge2.gap(ball1.center);
                best.take(gap - ball1.radius, -normal, (on_edge(i, s), on_edge(j, nearest)));
                let (gap, normal, nearest) = edge1.gap(ball2.center);
                best.take(gap - ball2.radius, normal, (on_edge(i, nearest), on_edge(j, t)));
            }
        }
    }
    best.take_faces(first, second);
    best
}

/// Barycentric weights of a vertex.
#[inline(always)]
fn at_vertex<R: Number, const N: usize>(i: usize, zero: R) -> [R; N] {
    each(
        #[inline(always)]
        |k| if k == i { zero.like(1.0) } else { zero },
    )
}

/// Barycentric weights of a sphere on the edge from a vertex to the next.
#[inline(always)]
fn on_edge<R: Number, const N: usize>(i: usize, t: R) -> [R; N] {
    each(
        #[inline(always)]
        |k| {
            if k == (i + 1) % N {
                t
            } else if k == i {
                t.like(1.0) - t
            } else {
                t.like(0.0)
            }
        },
    )
}

/// Barycentric weights of a sphere on a slab's face. Only slabs have a face.
#[inline(always)]
fn on_face<R: Number, const N: usize>(weights: [R; 3]) -> [R; N] {
    each(
        #[inline(always)]
        |k| weights[k],
    )
}

/// The nearest pair of spheres found so far.
pub(super) struct Nearest<R, const N: usize, const M: usize> {
    /// The distance of the two spheres: an upper bound of the primitives' distance.
    pub upper: R,
    /// Direction from the first to the second, of any length.
    pub normal: Vector<R>,
    /// Barycentric weights of the two spheres in their primitives.
    pub weights: ([R; N], [R; M]),
}

impl<R: Number, const N: usize, const M: usize> Nearest<R, N, M> {
    /// Takes the nearest points of faces and spheres of the other side.
    #[inline(always)]
    fn take_faces(&mut self, first: &[Ball<R>; N], second: &[Ball<R>; M]) {
        let zero = self.upper.like(0.0);
        if M == 3 {
            let face = Face::new(second[0], second[1 % M], second[2 % M]);
            for (i, ball) in first.iter().enumerate() {
                let (gap, normal, inside, weights) = face.gap(ball.center);
                self.take_if(inside, gap - ball.radius, -normal, (at_vertex(i, zero), on_face(weights)));
            }
        }
        if N == 3 {
            let face = Face::new(first[0], first[1 % N], first[2 % N]);
            for (j, ball) in second.iter().enumerate() {
                let (gap, normal, inside, weights) = face.gap(ball.center);
                self.take_if(inside, gap - ball.radius, normal, (on_face(weights), at_vertex(j, zero)));
            }
        }
    }

    #[inline(always)]
    fn take(&mut self, upper: R, normal: Vector<R>, weights: ([R; N], [R; M])) {
        self.select(upper.less(self.upper), upper, normal, weights);
    }

    #[inline(always)]
    fn take_if(&mut self, mask: R::Mask, upper: R, normal: Vector<R>, weights: ([R; N], [R; M])) {
        self.select(mask & upper.less(self.upper), upper, normal, weights);
    }

    #[inline(always)]
    fn select(&mut self, nearer: R::Mask, upper: R, normal: Vector<R>, weights: ([R; N], [R; M])) {
        self.upper = R::select(nearer, upper, self.upper);
        self.normal = Vector::select(nearer, normal, self.normal);
        for (weight, other) in self.weights.0.iter_mut().zip(weights.0) {
            *weight = R::select(nearer, other, *weight);
        }
        for (weight, other) in self.weights.1.iter_mut().zip(weights.1) {
            *weight = R::select(nearer, other, *weight);
        }
    }
}

/// An array of the results of `make` for each index: `std::array::from_fn`, always inlined.
#[inline(always)]
pub(super) fn each<T: Copy, const N: usize>(make: impl Fn(usize) -> T) -> [T; N] {
    let mut made = [make(0); N];
    for (i, slot) in made.iter_mut().enumerate().skip(1) {
        *slot = make(i);
    }
    made
}
