// What keeps the page of a run up to date while it goes on: its events, its pictures, and the debugger's buttons.

const live = {
  state: null, // of the connection: "open", "lost", "over"
  drawn: 0,

  start() {
    this.status = make("span", { cls: "pill", text: "connecting" });
    this.status.id = "connection";
    $("outcome").after(this.status);
    this.images = make("section", { cls: "pictures" }, [make("h2", { text: "Pictures" })]);
    this.images.hidden = true;
    $("node").before(this.images);
    if (data.live.says.includes("pause")) this.buildControls();
    if (data.live.says.includes("reload")) this.buildReload();
    for (const [name, serial] of Object.entries(data.live.pictures)) this.picture(name, serial);
    this.source = new EventSource(`events?since=${encodeURIComponent(data.live.since)}`);
    this.source.onopen = () => this.connected("open", play.end.is === "running" ? "live" : "the run is over");
    this.source.onerror = () => this.connected("lost", "no connection: trying again");
    this.source.onmessage = (event) => this.take(JSON.parse(event.data));
    this.source.addEventListener("closed", () => this.closed());
  },

  connected(state, text) {
    if (this.state === "over") return;
    this.state = state;
    this.status.textContent = text;
    this.status.dataset.is = { open: "success", lost: "failure", over: "idle" }[state];
  },

  closed() {
    this.source.close();
    this.connected("over", "the run is over, the server is gone");
  },

  take(news) {
    if (news.reload) return location.reload();
    const atEnd = still.tick >= play.lastTick;
    play.add(news);
    play.end = news.end;
    $("slider").max = play.lastTick;
    for (const id of ["failed-before", "failed-next"]) $(id).disabled = !play.failures.length;
    showWhy();
    if (atEnd && !player.running) seek(play.lastTick, { keep: true });
    else seek(still.tick, { keep: true });
    this.redraw();
    for (const [name, serial] of Object.entries(news.pictures ?? {})) this.picture(name, serial);
    if (this.controls) this.paused(news.paused, news.paused_s, news.over);
    if (this.reloading) this.reloaded(news.reloaded, news.over);
    if (news.end.is !== "running") this.connected("open", "the run is over");
  },

  // The strip costs most: at most twice a second.
  redraw() {
    clearTimeout(this.timer);
    const wait = Math.max(0, 500 - (performance.now() - this.drawn));
    this.timer = setTimeout(() => {
      this.drawn = performance.now();
      strip.draw();
      seek(still.tick, { keep: true });
    }, wait);
  },

  picture(name, serial) {
    this.images.hidden = false;
    let image = document.getElementById(`picture-${name}`);
    if (!image) {
      image = make("img");
      image.id = `picture-${name}`;
      image.alt = name === "map" ? "The map with the robot and its way" : `What the ${name} camera sees`;
      const figure = make("figure", {}, [image, make("figcaption", { text: name.replaceAll("_", " ") })]);
      this.images.append(figure);
    }
    image.src = `picture/${encodeURIComponent(name)}?${serial}`;
  },

  buildControls() {
    const button = (text, title, words) => {
      const made = make("button", { text, title, on: () => made.ariaDisabled === "true" || this.say(words()) });
      this.buttons.append(made);
      return made;
    };
    this.buttons = make("div", { cls: "buttons" });
    this.stands = make("span", { cls: "pill" });
    this.buttons.append(this.stands);
    this.pause = button("▮▮ Pause", "Pause at the next tick", () => ({ pause: "" }));
    this.steps = [
      button("▸ Next change", "Go on to the next change", () => ({ line: "n" })),
      button("⇥ Next tick", "Go on to the next tick", () => ({ line: "t" })),
      button("▶ Go on", "Go on to the next break", () => ({ line: "c" })),
      button("■ Stop", "Stop the episode, as Ctrl-C does", () => ({ line: "q" })),
    ];
    this.breaks = button("◉ Break at this node", "Pause where the node that is picked begins", () => ({ break: outline.picked }));
    this.said = make("pre", { cls: "said" });
    this.said.setAttribute("aria-live", "polite");
    this.controls = make("section", { cls: "controls" }, [make("h2", { text: "Debugger" }), this.buttons, this.said]);
    $("player").before(this.controls);
    this.paused(data.live.paused, data.live.paused_s, false);
    setInterval(() => this.count(), 1000);
  },

  // A button that says nothing now keeps the focus, so that who steps by keys can go on.
  paused(text, seconds, over) {
    this.controls.hidden = over;
    if (text !== this.news) this.said.textContent = text;
    this.news = text;
    this.controls.classList.toggle("paused", Boolean(text));
    this.since = text ? performance.now() - seconds * 1000 : null;
    this.pause.ariaDisabled = String(Boolean(text));
    for (const step of this.steps) step.ariaDisabled = String(!text);
    this.count();
  },

  // Wall time: the simulated one stands still.
  count() {
    const waits = this.since !== null;
    const seconds = waits ? Math.floor((performance.now() - this.since) / 1000) : 0;
    const passed = seconds < 60 ? `${seconds} s` : `${Math.floor(seconds / 60)} min ${seconds % 60} s`;
    this.stands.textContent = waits ? `▮▮ paused for ${passed}` : `${marks.running.unicode} running`;
    this.stands.dataset.is = waits ? "idle" : "running";
  },

  async say(words, said = this.said) {
    const answer = await fetch("control", { method: "POST", body: JSON.stringify(words) }).catch(() => null);
    if (!answer?.ok) said.textContent = answer ? await answer.text() : "no connection";
    else if (words.break) said.textContent = `breaks at ${words.break}`;
    else if ("reload" in words) said.textContent = "asked: at the next tick";
  },

  buildReload() {
    this.took = make("pre", { cls: "said" });
    const title = "What has changed in the file is put into the tree between two ticks; the rest goes on";
    const take = make("button", { text: "↻ Take its new text", title, on: () => this.say({ reload: "" }, this.took) });
    const buttons = make("div", { cls: "buttons" }, [take]);
    this.reloading = make("section", { cls: "controls" }, [make("h2", { text: "The tree's file" }), buttons, this.took]);
    $("player").before(this.reloading);
    this.reloaded(data.live.reloaded, false);
  },

  reloaded(text, over) {
    this.reloading.hidden = over;
    if (text) this.took.textContent = text;
  },
};
