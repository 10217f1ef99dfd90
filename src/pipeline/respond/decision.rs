//! Decides how an impact changes a body's state: a pure function of both bodies' states.

use super::trajectory::State;

/// The effect of an impact on a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Decision {
    /// The body continues its motion.
    GoOn,
    /// The body stops at the impact.
    Stop,
    /// The other body pushes the body along the contact normal.
    Push,
    /// The body stops between a pusher and an obstacle.
    Wedge,
}

/// The other side of an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Obstacle {
    /// A static body.
    Fixed,
    /// A body that stops at impacts, in this state.
    Stopping(State),
    /// A body that pushes. `approach`: length of the push along the normal that the rest of the step requires, in metres; negative if the bodies separate.
    /// `exhausted`: true if the body has been pushed as far as the pusher can push it.
    Pusher { approach: f32, exhausted: bool },
}

/// Decides the effect of an impact on a body that stops at impacts.
pub(super) fn decide(state: State, obstacle: Obstacle) -> Decision {
    match (state, obstacle) {
        (State::Wedged, _) => Decision::GoOn,
        (State::Free | State::Stopped, Obstacle::Pusher { .. }) => Decision::Push,
        (State::Free, _) => Decision::Stop,
        (State::Stopped, _) => Decision::GoOn,
        // The bodies separate in the rest of the step, so the pusher does not block the body.
        (State::Pushed, Obstacle::Pusher { approach, .. }) if approach < 0.0 => Decision::GoOn,
        (State::Pushed, Obstacle::Pusher { exhausted: false, .. }) => Decision::Push,
        // This body pushes the other one.
        (State::Pushed, Obstacle::Stopping(other)) if other < State::Pushed => Decision::GoOn,
        (State::Pushed, _) => Decision::Wedge,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUSHER: Obstacle = Obstacle::Pusher { approach: 0.1, exhausted: false };

    #[test]
    fn bodies_stop_at_each_other_and_at_statics() {
        assert_eq!(decide(State::Free, Obstacle::Fixed), Decision::Stop);
        assert_eq!(decide(State::Free, Obstacle::Stopping(State::Free)), Decision::Stop);
        assert_eq!(decide(State::Stopped, Obstacle::Stopping(State::Free)), Decision::GoOn);
    }

    #[test]
    fn kinematic_bodies_push_free_and_stopped_bodies() {
        for state in [State::Free, State::Stopped] {
            assert_eq!(decide(state, PUSHER), Decision::Push);
        }
        assert_eq!(decide(State::Pushed, PUSHER), Decision::Push);
    }

    #[test]
    fn pushed_bodies_are_wedged_at_obstacles_that_do_not_give_way() {
        assert_eq!(decide(State::Pushed, Obstacle::Fixed), Decision::Wedge);
        assert_eq!(decide(State::Pushed, Obstacle::Stopping(State::Wedged)), Decision::Wedge);
        assert_eq!(decide(State::Pushed, Obstacle::Stopping(State::Free)), Decision::GoOn);
        assert_eq!(decide(State::Pushed, Obstacle::Pusher { approach: 0.1, exhausted: true }), Decision::Wedge);
        for exhausted in [false, true] {
            assert_eq!(decide(State::Pushed, Obstacle::Pusher { approach: -0.1, exhausted }), Decision::GoOn);
        }
    }

    #[test]
    fn wedged_bodies_stay() {
        for obstacle in [Obstacle::Fixed, PUSHER, Obstacle::Stopping(State::Pushed)] {
            assert_eq!(decide(State::Wedged, obstacle), Decision::GoOn);
        }
    }
}
