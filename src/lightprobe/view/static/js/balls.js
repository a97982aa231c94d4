// A diffuse, a matte and a mirror ball beside the object: what they show of a light is easily read.

import * as THREE from "three";

const FINISHES = [
  { metalness: 0, roughness: 1 },
  { metalness: 1, roughness: 0.369 },
  { metalness: 1, roughness: 0 },
];

/** Return three balls in a row below the object, as `camera` sees it. */
export function makeBalls(radius, center, camera) {
  const size = radius * 0.24;
  const geometry = new THREE.SphereGeometry(size, 48, 32);
  const right = new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
  const row = new THREE.Group();
  FINISHES.forEach((finish, index) => {
    const ball = new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ color: 0xffffff, ...finish }));
    ball.position.copy(center).addScaledVector(right, (index - 1) * size * 2.4);
    ball.position.y -= radius * 1.12;
    row.add(ball);
  });
  return row;
}
