// Poses of gizmos as matrices, messages, and numbers that people type.

import { Euler, MathUtils, type Matrix4, Quaternion, Vector3 } from "three";
import type { Pose } from "../protocol";

/** Return the pose of a rigid transform. */
export function poseOf(matrix: Matrix4): Pose {
  const translation = new Vector3();
  const q = new Quaternion();
  matrix.decompose(translation, q, new Vector3());
  return { translation: translation.toArray(), quaternion: [q.w, q.x, q.y, q.z] };
}

/** Return position, and roll, pitch and yaw in degrees. */
export function numbersOf({ translation, quaternion: [w, x, y, z] }: Pose): number[] {
  const angles = new Euler().setFromQuaternion(new Quaternion(x, y, z, w), "ZYX");
  const degrees = [angles.x, angles.y, angles.z].map((angle) => MathUtils.radToDeg(angle));
  return [...translation, ...degrees].map((number) => Math.round(number * 1e9) / 1e9);
}

/** Return the pose with the numbers of `numbersOf`. */
export function poseOfNumbers(numbers: number[]): Pose {
  const [x = 0, y = 0, z = 0, ...degrees] = numbers;
  const [roll = 0, pitch = 0, yaw = 0] = degrees.map((angle) => MathUtils.degToRad(angle));
  const q = new Quaternion().setFromEuler(new Euler(roll, pitch, yaw, "ZYX"));
  return { translation: [x, y, z], quaternion: [q.w, q.x, q.y, q.z] };
}
