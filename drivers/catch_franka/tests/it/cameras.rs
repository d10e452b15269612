//! Images from Python arrive as they were sent.

use std::{path::Path, process::Command, time::Duration};

use catch_body::Pose;
use catch_cell::CameraModel;
use catch_driver::{
    camera_socket::{self, FrameStatus},
    clock::Clock,
};

const SENDS: &str = "
import sys, time
sys.path.insert(0, sys.argv[1])
import numpy as np
from sender import Sender
sender = Sender(sys.argv[2])
image = np.arange(12, dtype='<u2').reshape(3, 4)
sender.send(0, time.monotonic(), image)
sender.send(1, time.monotonic(), image.astype('<f4') / 8)
sender.send(0, time.monotonic(), image)
try:
    sender.send(0, 0.0, image.astype('f8'))
except ValueError as fault:
    assert 'float64' in str(fault)
";

#[test]
#[ignore = "needs NumPy"]
fn images_from_python_arrive_as_they_were_sent() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("cameras");
    let camera = CameraModel::with_field_of_view(Pose::identity(), 4, 3, 1.0);
    let images = camera_socket::listen(&socket, &[camera.clone(), camera], &Clock::Host).unwrap();
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = here.join("../../target/franka/venv/bin/python");
    let sent = Command::new(python).args(["-c", SENDS]).arg(here.join("../cameras")).arg(&socket).status().unwrap();
    assert!(sent.success());
    let arrived: Vec<_> = (0..3).map(|_| images.recv_timeout(Duration::from_secs(5)).unwrap()).collect();
    let statuses = [FrameStatus::Fresh, FrameStatus::Fresh, FrameStatus::Frozen];
    assert_eq!(arrived.iter().map(|it| it.status).collect::<Vec<_>>(), statuses);
    assert_eq!(arrived.iter().map(|it| it.frame.camera).collect::<Vec<_>>(), [0, 1, 0]);
    for i in 0..12 {
        assert!((arrived[0].frame.depth_m[i] - i as f32 * 1e-3).abs() < 1e-9);
        assert_eq!(arrived[1].frame.depth_m[i], i as f32 / 8.0);
    }
}
