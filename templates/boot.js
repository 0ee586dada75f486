"use strict";
// Draws each plot over its still picture when it comes near the screen, and lets the buttons beside it steer it.
(() => {
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const started = performance.now();

  // Columns travel as 16-bit steps between their lowest and highest value; 65535 is a missing one.
  const doubles = (column) => {
    const raw = Uint8Array.from(atob(column.steps), (c) => c.charCodeAt(0));
    const steps = new DataView(raw.buffer);
    const unit = (column.high - column.low) / 65534;
    const values = new Float64Array(raw.length / 2);
    for (let i = 0; i < values.length; i++) {
      const step = steps.getUint16(2 * i, true);
      values[i] = step === 65535 ? NaN : column.low + step * unit;
    }
    return { type: "ndarray", array: { type: "bytes", data: values }, shape: [values.length], dtype: "float64", order: "little" };
  };
  // A heat map travels as one byte a cell.
  const image = (packed) => ({
    type: "ndarray", array: { type: "bytes", data: Uint8Array.from(atob(packed.levels), (c) => c.charCodeAt(0)) },
    shape: packed.shape, dtype: "uint8", order: "little",
  });
  const value = (given) => (given === null ? NaN : typeof given === "object" ? image(given) : given);
  const unpack = (plot) => {
    for (const root of plot.doc.roots)
      for (const renderer of root.attributes.renderers) {
        const data = renderer.attributes.data_source.attributes.data;
        data.entries = data.entries.map(([name, column]) => [name,
          Array.isArray(column) ? column.map(value) : doubles(column)]);
      }
  };

  const tools = { pan: "PanTool", box: "BoxZoomTool", wheel: "WheelZoomTool" };
  const steer = (figure, models, views) => {
    const each = (type, act) => {
      for (const model of models) for (const tool of model.toolbar.tools) if (tool.type === type) act(tool);
    };
    const buttons = figure.querySelectorAll("[data-tool]");
    for (const button of buttons)
      button.addEventListener("click", () => {
        const name = button.dataset.tool;
        if (name === "reset") {
          for (const view of views) view.reset();
        } else if (name === "wheel") {
          const on = button.getAttribute("aria-pressed") !== "true";
          each(tools.wheel, (tool) => { tool.active = on; });
          button.setAttribute("aria-pressed", on);
        } else {
          each(tools[name], (tool) => { tool.active = true; });
          for (const other of buttons)
            if (other.dataset.tool === "pan" || other.dataset.tool === "box")
              other.setAttribute("aria-pressed", other === button);
        }
      });
  };

  const embed = async (figure) => {
    const name = figure.dataset.plot;
    const plot = plots[name];
    const holders = figure.querySelectorAll("[data-panel]");
    const roots = {};
    plot.roots.forEach((id, i) => { roots[id] = holders[i].id; });
    unpack(plot);
    figure.classList.add("live");
    try {
      const managers = await Bokeh.embed.embed_items({ [name]: plot.doc }, [{ docid: name, roots, root_ids: plot.roots }]);
      delete plots[name];
      const views = managers.flatMap((manager) => Array.from(manager)).filter((view) => plot.roots.includes(view.model.id));
      steer(figure, views.map((view) => view.model), views);
      figure.dataset.drawn = Math.round(performance.now());
      const root = document.documentElement;
      root.dataset.firstPlot ??= figure.dataset.drawn;
      root.dataset.drawn = Number(root.dataset.drawn ?? 0) + 1;
    } catch (error) {
      figure.classList.remove("live");
      console.error(`${name} stays a still picture:`, error);
    }
  };

  // One at a time, and only what is still near the screen when its turn comes: a reader who jumps waits for nothing.
  let queue = Promise.resolve();
  const near = (figure) => {
    const box = figure.getBoundingClientRect();
    return box.bottom > -300 && box.top < innerHeight + 300;
  };
  const turn = (figure) => (near(figure) ? embed(figure) : watch.observe(figure));
  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries)
      if (entry.isIntersecting) {
        watch.unobserve(entry.target);
        queue = queue.then(() => turn(entry.target));
      }
  }, { rootMargin: "250px" });
  Bokeh.set_log_level("error");
  document.documentElement.dataset.booted = Math.round(started);
  const figures = [...document.querySelectorAll("[data-plot]")];
  // The first is alive before the reader comes to it; the others when they come near.
  if (figures.length) queue = queue.then(() => embed(figures[0]));
  for (const figure of figures.slice(1)) watch.observe(figure);

  // The table of contents shows where the reader is.
  const links = new Map();
  for (const link of document.querySelectorAll("nav a[href^='#']")) links.set(link.hash.slice(1), link);
  const spy = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const link = links.get(entry.target.id);
      if (link && entry.isIntersecting) {
        for (const other of links.values()) other.removeAttribute("aria-current");
        link.setAttribute("aria-current", "true");
      }
    }
  }, { rootMargin: "-10% 0px -75% 0px" });
  for (const section of document.querySelectorAll("main section[id]")) spy.observe(section);
})();
