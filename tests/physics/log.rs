//! What has been logged, by all tests: each looks for the names of its own.

use std::{
    fmt::Write,
    sync::{Mutex, Once},
};

use bevy::log::{
    Level,
    tracing::{
        Event, Subscriber,
        field::{Field, Visit},
        subscriber::set_global_default,
    },
    tracing_subscriber::{Layer, layer::Context, prelude::*, registry},
};

static LINES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// What is of this level or worse.
struct Keep(Level);

impl<S: Subscriber> Layer<S> for Keep {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if *event.metadata().level() <= self.0 {
            let mut line = Line(String::new());
            event.record(&mut line);
            LINES.lock().unwrap().push(line.0);
        }
    }
}

struct Line(String);

impl Visit for Line {
    fn record_debug(&mut self, _: &Field, value: &dyn std::fmt::Debug) {
        write!(self.0, "{value:?} ").unwrap();
    }
}

/// Keeps warnings and errors from now on.
pub fn keep() {
    keep_from(Level::WARN);
}

/// Keeps from now on what is of this level or worse. The first call counts.
pub fn keep_from(level: Level) {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| set_global_default(registry().with(Keep(level))).unwrap());
}

/// What was kept and holds the text.
pub fn lines(text: &str) -> Vec<String> {
    LINES.lock().unwrap().iter().filter(|line| line.contains(text)).cloned().collect()
}
