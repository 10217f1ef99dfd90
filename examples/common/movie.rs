//! An animated picture as GIF.

use std::{fs, path::Path};

use bevy::{prelude::*, render::view::screenshot::ScreenshotCaptured};
use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use indicatif::ProgressBar;

use super::studio::{Studio, set_camera};

/// Duration of the last frame, in hundredths of a second.
const LAST_DELAY: u16 = 150;

/// Steps between the pictures of a movie.
const MOVIE_STEPS: u32 = 3;

/// Max number of frames until the renderer has returned the last picture of a movie.
const MOVIE_PATIENCE: u32 = 20;

/// Frames so far. A pixel that has the colour of the frame before is transparent, so a resting background takes almost no space.
#[derive(Resource)]
struct Movie {
    frames: Vec<Frame<'static>>,
    size: [u16; 2],
    delay: u16,
    /// Colours of the last frame, four bytes for each pixel.
    last: Vec<u8>,
}

impl Movie {
    /// An empty movie with pictures of a size in pixels, each shown for `seconds`.
    fn new(size: UVec2, seconds: f32) -> Self {
        let size = [size.x, size.y].map(|side| u16::try_from(side).unwrap_or(u16::MAX));
        Self { frames: Vec::new(), size, delay: (seconds * 100.0).round() as u16, last: Vec::new() }
    }

    /// Number of frames.
    fn len(&self) -> usize {
        self.frames.len()
    }

    /// Adds a picture with four bytes for each pixel. Pictures of another size are left out.
    fn add(&mut self, picture: &[u8]) {
        let [width, height] = self.size;
        if picture.len() != 4 * usize::from(width) * usize::from(height) {
            return;
        }
        let mut pixels = picture.to_vec();
        for (pixel, last) in pixels.as_chunks_mut::<4>().0.iter_mut().zip(self.last.as_chunks::<4>().0) {
            if pixel == last {
                *pixel = [0; 4];
            }
        }
        self.last = picture.to_vec();
        let mut frame = Frame::from_rgba_speed(width, height, &mut pixels, 10);
        (frame.delay, frame.dispose) = (self.delay, DisposalMethod::Keep);
        self.frames.push(frame);
    }

    /// The movie as a file, which repeats without end.
    ///
    /// # Errors
    /// Errors of the encoder.
    fn encode(&mut self) -> Result<Vec<u8>, EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.size[0], self.size[1], &[])?;
        encoder.set_repeat(Repeat::Infinite)?;
        if let Some(last) = self.frames.last_mut() {
            last.delay = LAST_DELAY;
        }
        self.frames.iter().try_for_each(|frame| encoder.write_frame(frame))?;
        drop(encoder);
        Ok(bytes)
    }
}

/// Runs an app for `steps` updates of `dt` seconds and writes a movie that shows every third one.
pub fn record(studio: &mut Studio, steps: u32, dt: f32, file: &Path) -> Result<(), String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
    if steps <= MOVIE_STEPS {
        return Err(format!("a movie of {steps} steps has no picture; run more than {MOVIE_STEPS}"));
    }
    bevy_medial::whole_file::check(file).map_err(|error| failed(&error))?;
    studio.app.insert_resource(Movie::new(studio.size, dt * MOVIE_STEPS as f32));
    // The first frame is empty.
    studio.app.update();
    let progress = ProgressBar::new(steps.into());
    for step in 1..steps {
        let is_shown = step % MOVIE_STEPS == 0;
        set_camera(&mut studio.app, is_shown);
        if is_shown {
            studio.shoot(|picture: On<ScreenshotCaptured>, mut movie: ResMut<Movie>| {
                movie.add(picture.image.data.as_deref().unwrap_or_default());
            });
        }
        studio.app.update();
        progress.inc(1);
    }
    progress.finish_and_clear();
    let wanted = (steps.saturating_sub(1) / MOVIE_STEPS) as usize;
    for _ in 0..MOVIE_PATIENCE {
        if studio.app.world().resource::<Movie>().len() == wanted {
            let bytes = studio.app.world_mut().resource_mut::<Movie>().encode().map_err(|error| failed(&error))?;
            return fs::write(file, bytes).map_err(|error| failed(&error));
        }
        studio.app.update();
    }
    Err(failed(&"the renderer returned too few pictures"))
}
