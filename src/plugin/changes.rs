use std::collections::HashSet;

use bevy::{ecs::system::SystemParam, prelude::*};

/// Tells which assets are no longer what they were.
#[derive(SystemParam)]
pub(crate) struct Changes<'w, 's, A: Asset> {
    events: MessageReader<'w, 's, AssetEvent<A>>,
    /// Those that were taken out while somebody has a handle.
    removed: Local<'s, HashSet<AssetId<A>>>,
}

impl<A: Asset> Changes<'_, '_, A> {
    /// Those that have been changed, or put back, since this was asked last.
    pub fn read(&mut self) -> Vec<AssetId<A>> {
        let (mut changed, mut unused) = (Vec::new(), Vec::new());
        for event in self.events.read() {
            match event {
                AssetEvent::Modified { id } => changed.push(*id),
                AssetEvent::Added { id } if self.removed.remove(id) => changed.push(*id),
                AssetEvent::Removed { id } => _ = self.removed.insert(*id),
                AssetEvent::Unused { id } => unused.push(*id),
                _ => {}
            }
        }
        // These do not come back.
        unused.iter().for_each(|id| _ = self.removed.remove(id));
        changed
    }
}
