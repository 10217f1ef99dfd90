//! Decides the state of a body after an impact: a pure function of both bodies' states.

use super::trajectory::State;

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

/// Returns the new state of a body that stops at impacts; `None` if the body continues its motion.
pub(super) fn decide(state: State, obstacle: Obstacle) -> Option<State> {
    match (state, obstacle) {
        (State::Wedged, _) => None,
        (State::Free | State::Stopped, Obstacle::Pusher { .. }) => Some(State::Pushed),
        (State::Free, _) => Some(State::Stopped),
        (State::Stopped, _) => None,
        // The bodies separate in the rest of the step, so the pusher does not block the body.
        (State::Pushed, Obstacle::Pusher { approach, .. }) if approach < 0.0 => None,
        (State::Pushed, Obstacle::Pusher { exhausted: false, .. }) => Some(State::Pushed),
        // This body pushes the other one.
        (State::Pushed, Obstacle::Stopping(other)) if other < State::Pushed => None,
        (State::Pushed, _) => Some(State::Wedged),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUSHER: Obstacle = Obstacle::Pusher { approach: 0.1, exhausted: false };

    #[test]
    fn bodies_stop_at_each_other_and_at_statics() {
        assert_eq!(decide(State::Free, Obstacle::Fixed), Some(State::Stopped));
        assert_eq!(decide(State::Free, Obstacle::Stopping(State::Free)), Some(State::Stopped));
        assert_eq!(decide(State::Stopped, Obstacle::Stopping(State::Free)), None);
    }

    #[test]
    fn kinematic_bodies_push_free_and_stopped_bodies() {
        for state in [State::Free, State::Stopped] {
            assert_eq!(decide(state, PUSHER), Some(State::Pushed));
        }
        assert_eq!(decide(State::Pushed, PUSHER), Some(State::Pushed));
    }

    #[test]
    fn pushed_bodies_are_wedged_at_obstacles_that_do_not_give_way() {
        assert_eq!(decide(State::Pushed, Obstacle::Fixed), Some(State::Wedged));
        assert_eq!(decide(State::Pushed, Obstacle::Stopping(State::Wedged)), Some(State::Wedged));
        assert_eq!(decide(State::Pushed, Obstacle::Stopping(State::Free)), None);
        assert_eq!(decide(State::Pushed, Obstacle::Pusher { approach: 0.1, exhausted: true }), Some(State::Wedged));
        for exhausted in [false, true] {
            assert_eq!(decide(State::Pushed, Obstacle::Pusher { approach: -0.1, exhausted }), None);
        }
    }

    #[test]
    fn wedged_bodies_stay() {
        for obstacle in [Obstacle::Fixed, PUSHER, Obstacle::Stopping(State::Pushed)] {
            assert_eq!(decide(State::Wedged, obstacle), None);
        }
    }
}
