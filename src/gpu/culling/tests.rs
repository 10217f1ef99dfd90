use super::*;
use crate::{
    geometry::{Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Shape},
};

/// Two batches are in progress when buffers turn out to be too small, as in pipelined mode.
#[test]
fn a_batch_from_before_buffers_grew_is_not_taken() {
    let gpu = match GpuDevice::request() {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("MEDIAL_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(_) => return,
    };
    let shape = Shape { axis: MedialAxis::torus(0.5, 0.1, 24).unwrap(), scale: 1.0 };
    let body = |x: f32| Body::new(shape.clone(), Sweep::at_rest(Pose3::from_translation(Vec3::X * x)));
    let input = StepInput { bodies: vec![body(0.0), body(0.1)], prediction: 0.01, ..Default::default() };
    let capacity = GpuCapacity { candidates: [1; KINDS], ..GpuCapacity::default() };
    let mut culling = GpuCulling::new(&gpu, capacity).unwrap();
    culling.upload(&input, &Statics::default(), &KinematicReach::new(&input), |_| 0.0).unwrap();
    let taken = [(); 2].map(|()| {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let batch = culling.encode(&mut encoder).unwrap();
        let data = gpu.read(&batch.staging, batch.bytes, gpu.queue.submit([encoder.finish()])).unwrap();
        (batch, data)
    });
    assert!(Room::counts(&taken[0].1).candidates[0] > 1);
    for (batch, data) in taken {
        assert!(culling.take(batch, &data).is_none(), "a batch without all candidates was taken");
    }
    assert_eq!(culling.cull(&input, &Statics::default()).unwrap().len(), 1);
}
