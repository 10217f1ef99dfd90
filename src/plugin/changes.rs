use std::collections::HashSet;

use bevy::{ecs::system::SystemParam, prelude::*};

/// Reports which assets have changed.
#[derive(SystemParam)]
pub(crate) struct Changes<'w, 's, A: Asset> {
    events: MessageReader<'w, 's, AssetEvent<A>>,
    /// Assets that were removed while a handle still exists.
    removed: Local<'s, HashSet<AssetId<A>>>,
}

impl<A: Asset> Changes<'_, '_, A> {
    /// Returns the assets that were modified, or inserted again, since the last call.
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
        // An asset without handles is never inserted again.
        unused.iter().for_each(|id| _ = self.removed.remove(id));
        changed
    }
}
