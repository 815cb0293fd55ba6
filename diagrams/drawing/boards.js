// Keeps the legend and the events in Meshcat's view whole and readable, however small the window.
(() => {
  if (globalThis.keepsBoards) return; // The page may bring this script already.
  globalThis.keepsBoards = true;
  const line = 0.022; // Height of a line of text, [m].
  const readable = 18; // The same on the screen at least, [pixels].
  const margin = 0.02; // Between a board and the window's edge, [m].
  let placed = "";

  function boards() {
    const held = viewer.scene_tree.find(["Cameras", "default", "rotated", "<object>"]).children;
    return [held.legend, ...Object.values(held.events?.children ?? {})].filter(Boolean);
  }

  function sizeOf(board) {
    let size = null;
    board.traverse(({ geometry }) => {
      if (!geometry) return;
      geometry.computeBoundingBox();
      const { min, max } = geometry.boundingBox;
      size = [max.x - min.x, max.y - min.y];
    });
    return size;
  }

  function place(board) {
    const size = sizeOf(board);
    if (!size) return;
    const { camera } = viewer;
    const first = (board.userData.first ??= board.position.clone());
    const halfHeight = (-first.z * Math.tan((camera.fov * Math.PI) / 360)) / camera.zoom;
    const halfWidth = halfHeight * camera.aspect;
    const [width, height] = size;
    const scale = Math.min(
      Math.max(1, (readable * 2 * halfHeight) / (line * innerHeight)),
      (2 * (halfWidth - margin)) / width,
      (halfHeight - margin) / height, // Half of the window.
    );
    const left = Math.max(first.x - width / 2, margin - halfWidth);
    const isLow = first.y < 0;
    const edge = isLow
      ? Math.max(first.y - height / 2, margin - halfHeight)
      : Math.min(first.y + height / 2, halfHeight - margin);
    const y = edge + ((isLow ? 1 : -1) * scale * height) / 2;
    board.position.set(left + (scale * width) / 2, y, first.z);
    board.scale.setScalar(scale);
  }

  setInterval(() => {
    if (!globalThis.viewer?.scene_tree) return;
    const found = boards();
    const now = [innerWidth, innerHeight, viewer.camera.aspect, found.filter(({ object }) => sizeOf(object)).length].join();
    if (now === placed) return;
    placed = now;
    found.forEach(({ object }) => place(object));
    viewer.set_dirty();
  }, 300);
})();
