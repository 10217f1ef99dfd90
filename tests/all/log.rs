//! A log that all tests share. Each test searches it for names that only this test uses.

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

/// A layer that records events of this level or a more severe one.
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

/// Starts to record events of level `INFO` and more severe ones. Further calls do nothing.
pub fn keep() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| set_global_default(registry().with(Keep(Level::INFO))).unwrap());
}

/// The recorded lines that contain the text.
pub fn lines(text: &str) -> Vec<String> {
    LINES.lock().unwrap().iter().filter(|line| line.contains(text)).cloned().collect()
}
