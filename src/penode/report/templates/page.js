// Draws the figures, in the colours the reader prefers and the width the page has.
(() => {
  "use strict";
  const NARROW = 620; // px; below it, panels stand in a pile
  const PAPER = 770; // px; the width of a figure on paper, before it is printed at 0.44 of it
  const CONFIG = { displayModeBar: false, scrollZoom: false, doubleClick: "reset" };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const touch = matchMedia("(pointer: coarse)");
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const twins = read("palette");
  const plots = [...document.querySelectorAll("[data-plot]")];

  const painted = (value, isDark) => {
    if (typeof value === "string") return (isDark && twins[value]) || value;
    if (Array.isArray(value)) return value.map((item) => painted(item, isDark));
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(
      Object.entries(value).map(([key, item]) => [key, painted(item, isDark)]));
  };

  const merged = (base, changes) => {
    const result = { ...base };
    for (const [key, change] of Object.entries(changes)) {
      const nested = change && typeof change === "object" && !Array.isArray(change);
      result[key] = nested ? merged(result[key] || {}, change) : change;
    }
    return result;
  };

  const hasWebGL = (() => {
    try {
      const canvas = document.createElement("canvas");
      return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
    } catch { return false; }
  })();

  // What the reader zoomed or turned, by figure: path in the layout to value. It outlives redraws.
  const views = new Map(plots.map((element) => [element, new Map()]));
  const remember = (element, changes) => {
    for (const [path, value] of Object.entries(changes)) {
      if (/range|camera/.test(path)) views.get(element).set(path, value);
    }
  };
  const put = (layout, path, value) => {
    const keys = path.match(/[^.[\]]+/g);
    const last = keys.pop();
    const parent = keys.reduce((node, key) => (node[key] ??= key === "range" ? [] : {}), layout);
    parent[last] = value;
  };

  const isSpatial = (data) => data.some((trace) => trace.type === "surface");

  const picture = (element, isDark, width) => {
    const { data, layout: wide } = painted(read(element.dataset.plot), isDark);
    const narrow = width < NARROW && wide.meta && wide.meta.narrow;
    const layout = { ...(narrow ? merged(wide, narrow) : wide), width };
    if (touch.matches && !isSpatial(data)) layout.dragmode = false;
    views.get(element).forEach((value, path) => put(layout, path, value));
    return { data, layout };
  };

  const draw = (element, isDark, width) => {
    const { data, layout } = picture(element, isDark, width);
    if (isSpatial(data) && !hasWebGL) {
      element.style.minHeight = "0";
      element.closest("figure").querySelector(".tools")?.remove();
      element.innerHTML = "<p class=\"unavailable\">This browser draws no three-dimensional "
        + "pictures (WebGL is off). The contours show the same map.</p>";
      return undefined;
    }
    element.style.minHeight = `${layout.height}px`;
    return Plotly.react(element, data, layout, CONFIG);
  };

  const drawAll = (isDark, width) =>
    Promise.all(plots.map((element) => draw(element, isDark, width || element.clientWidth)));

  // Keys: what a mouse does by dragging, for those without one.
  const turn = (element, angle, factor) => {
    const changes = {};
    for (const name of Object.keys(element._fullLayout).filter((key) => /^scene\d*$/.test(key))) {
      const { x, y, z } = element._fullLayout[name].camera.eye;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      changes[`${name}.camera.eye`] = {
        x: factor * (x * c - y * s), y: factor * (x * s + y * c), z: factor * z };
    }
    return changes;
  };
  const move = (element, letter, shift, factor) => {
    const changes = {};
    for (const name of Object.keys(element._fullLayout).filter((k) => RegExp(`^${letter}axis\\d*$`).test(k))) {
      const [low, high] = element._fullLayout[name].range;
      const [middle, half] = [(low + high) / 2 + shift * (high - low), factor * (high - low) / 2];
      changes[`${name}.range[0]`] = middle - half;
      changes[`${name}.range[1]`] = middle + half;
    }
    return changes;
  };
  const zoom = (element, factor) => ({
    ...move(element, "x", 0, factor),
    ...(element._fullLayout.yaxis.scaleanchor ? move(element, "y", 0, factor) : {}),
  });
  const reset = (element) => {
    views.get(element).clear();
    draw(element, dark.matches, element.clientWidth);
  };
  // Images are for white pages, whatever the screen shows.
  const save = (element) => {
    const { data, layout } = picture(element, false, element.clientWidth);
    layout.paper_bgcolor = "#ffffff";
    Plotly.downloadImage({ data, layout }, {
      format: "png", scale: 2, width: layout.width, height: layout.height,
      filename: element.closest("figure").id });
  };
  // As a click on an entry of the legend does.
  const toggle = (element, number) => {
    const traces = element._fullData;
    const entry = traces.filter((trace) => trace.showlegend)[number - 1];
    if (!entry || !element._fullLayout.showlegend) return;
    const group = entry.legendgroup;
    const same = traces.filter((trace) => trace === entry || (group && trace.legendgroup === group));
    const visible = entry.visible === true ? "legendonly" : true;
    Plotly.restyle(element, { visible }, same.map((trace) => trace.index));
  };
  const onKey = (event) => {
    const element = event.currentTarget;
    if (event.target !== element || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!element._fullLayout) return;
    const spatial = Boolean(element._fullLayout.scene);
    const steps = {
      ArrowLeft: () => spatial ? turn(element, -0.15, 1) : move(element, "x", -0.1, 1),
      ArrowRight: () => spatial ? turn(element, 0.15, 1) : move(element, "x", 0.1, 1),
      ArrowUp: () => spatial ? {} : move(element, "y", 0.1, 1),
      ArrowDown: () => spatial ? {} : move(element, "y", -0.1, 1),
      "+": () => spatial ? turn(element, 0, 0.85) : zoom(element, 0.7),
      "-": () => spatial ? turn(element, 0, 1 / 0.85) : zoom(element, 1 / 0.7),
    };
    if (event.key === "0") {
      reset(element);
    } else if (/^[1-9]$/.test(event.key)) {
      toggle(element, Number(event.key));
    } else if (steps[event.key]) {
      Plotly.relayout(element, steps[event.key]());
    } else {
      return;
    }
    event.preventDefault();
  };

  let pending = 0;
  const refit = () => {
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(() => drawAll(dark.matches));
  };
  for (const element of plots) {
    element.replaceChildren();
    element.addEventListener("keydown", onKey);
    for (const [label, action] of [["Reset view", reset], ["Save image", save]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.addEventListener("click", () => action(element));
      element.closest("figure").querySelector(".tools").append(button);
    }
  }
  drawAll(dark.matches).then(() => {
    for (const element of plots) {
      element.on?.("plotly_relayout", (changes) => remember(element, changes));
    }
    document.documentElement.setAttribute("data-drawn", "");
  });
  dark.addEventListener("change", refit);
  addEventListener("resize", refit);
  addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((one) => { one.open = true; });
    drawAll(false, PAPER);
  });
  addEventListener("afterprint", refit);

  // The contents show where the reader is.
  const links = new Map([...document.querySelectorAll("nav a")].map((a) => [a.hash.slice(1), a]));
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries.filter((one) => one.isIntersecting)) {
      links.forEach((link) => link.removeAttribute("aria-current"));
      links.get(entry.target.id)?.setAttribute("aria-current", "true");
    }
  }, { rootMargin: "-10% 0px -80% 0px" });
  document.querySelectorAll("main > section").forEach((part) => seen.observe(part));
})();
