//! An animated picture of a scene as GIF.

use bevy::prelude::*;
use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};

/// Duration of the last frame, in hundredths of a second.
const LAST_DELAY: u16 = 150;

/// Frames so far. A pixel that has the colour of the frame before is transparent, so a resting background takes almost no space.
#[derive(Resource)]
pub struct Movie {
    frames: Vec<Frame<'static>>,
    size: [u16; 2],
    delay: u16,
    /// Colours of the last frame, four bytes for each pixel.
    last: Vec<u8>,
}

impl Movie {
    /// An empty movie with pictures of a size in pixels, each shown for `seconds`.
    pub fn new(size: UVec2, seconds: f32) -> Self {
        let size = [size.x, size.y].map(|side| u16::try_from(side).unwrap_or(u16::MAX));
        Self { frames: Vec::new(), size, delay: (seconds * 100.0).round() as u16, last: Vec::new() }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Adds a picture with four bytes for each pixel. Pictures of another size are left out.
    pub fn add(&mut self, picture: &[u8]) {
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
    pub fn encode(&mut self) -> Result<Vec<u8>, EncodingError> {
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
