/* A hand of two fingers that a library in C generates. The macros make it break the rules of the interface one by one. */
#include "eigenhand_hand.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef MAGIC
#define MAGIC EIGENHAND_HAND_MAGIC
#endif
#ifndef MAJOR
#define MAJOR EIGENHAND_HAND_ABI_MAJOR
#endif
#ifndef MINOR
#define MINOR EIGENHAND_HAND_ABI_MINOR
#endif
#ifndef STRUCT_SIZE
#define STRUCT_SIZE sizeof(eigenhand_hand_plugin_t)
#endif
#ifndef SYMBOL
#define SYMBOL eigenhand_hand_plugin
#endif
#ifndef N_FILES
#define N_FILES 2
#endif
#ifndef MODEL_NAME
#define MODEL_NAME "model.xml"
#endif
#ifndef MODEL_NAME_LEN
#define MODEL_NAME_LEN strlen(MODEL_NAME)
#endif
#ifndef MODEL_DATA
#define MODEL_DATA hand->model
#endif
#ifndef MODEL_LEN
#define MODEL_LEN strlen(hand->model)
#endif
#ifndef FILE_STATUS
#define FILE_STATUS EIGENHAND_HAND_OK
#endif
#ifndef GENERATE
#define GENERATE generate
#endif
#ifndef MANIFEST_END
#define MANIFEST_END ""
#endif

struct hand {
    char manifest[1024];
    char model[4096];
    char error[256];
};

/* Looks for `width = NUMBER` in the options; a plugin of more than one option uses a TOML library. */
static int read_width(const uint8_t *options, size_t len, double *width, char *error, size_t error_len) {
    char text[256];
    if (len == 0) {
        return 1;
    }
    if (len >= sizeof text) {
        snprintf(error, error_len, "more options than `width`");
        return 0;
    }
    memcpy(text, options, len);
    text[len] = 0;
    if (sscanf(text, "width = %lf", width) != 1 || *width <= 0) {
        snprintf(error, error_len, "`width`: expected a positive number of metres, got %s", text);
        return 0;
    }
    return 1;
}

static eigenhand_status generate(const uint8_t *options, size_t options_len, void **out) {
#ifdef NO_HAND
    (void)options, (void)options_len, (void)out, (void)read_width;
    return NO_HAND;
#else
    double width = 0.06;
    struct hand *hand = calloc(1, sizeof *hand);
    *out = hand;
    if (!hand || !read_width(options, options_len, &width, hand->error, sizeof hand->error)) {
        return EIGENHAND_HAND_ERROR;
    }
    snprintf(hand->manifest, sizeof hand->manifest,
             "schema = 1\nname = \"c-pincer\"\nmodel = \"model.xml\"\npalm = \"base\"\n"
             "fingertips = [\"left\", \"right\"]\n[mount]\nposition = [0.0, 0.0, 0.2]\n" MANIFEST_END);
    snprintf(hand->model, sizeof hand->model,
             "<mujoco><worldbody><body name=\"base\"><geom size=\"0.02\"/>\n"
             "<body name=\"left\" pos=\"0 %g 0\"><joint name=\"left_turn\" axis=\"1 0 0\" limited=\"true\" range=\"-40 40\"/>"
             "<geom size=\"0.01\"/></body>\n"
             "<body name=\"right\" pos=\"0 %g 0\"><joint name=\"right_turn\" axis=\"1 0 0\" limited=\"true\" range=\"-40 40\"/>"
             "<geom size=\"0.01\"/></body>\n"
             "</body></worldbody><actuator>\n"
             "<position name=\"left_drive\" joint=\"left_turn\" ctrllimited=\"true\" ctrlrange=\"-0.7 0.7\"/>\n"
             "<position name=\"right_drive\" joint=\"right_turn\" ctrllimited=\"true\" ctrlrange=\"-0.7 0.7\"/>\n"
             "</actuator></mujoco>\n",
             width / 2, -width / 2);
    return EIGENHAND_HAND_OK;
#endif
}

static eigenhand_status file_count(const void *handle, size_t *out) {
    (void)handle;
    *out = N_FILES;
    return EIGENHAND_HAND_OK;
}

static eigenhand_status file(const void *handle, size_t index, eigenhand_bytes *name, eigenhand_bytes *content) {
    const struct hand *hand = handle;
    if (index == 0) {
        name->data = (const uint8_t *)"hand.toml";
        name->len = strlen("hand.toml");
        content->data = (const uint8_t *)hand->manifest;
        content->len = strlen(hand->manifest);
        return EIGENHAND_HAND_OK;
    }
    name->data = (const uint8_t *)MODEL_NAME;
    name->len = MODEL_NAME_LEN;
    content->data = (const uint8_t *)MODEL_DATA;
    content->len = MODEL_LEN;
    return FILE_STATUS;
}

static eigenhand_status error_message(const void *handle, eigenhand_bytes *out) {
    const struct hand *hand = handle;
    out->data = (const uint8_t *)hand->error;
    out->len = strlen(hand->error);
    return EIGENHAND_HAND_OK;
}

static void release(void *handle) {
    free(handle);
}

#ifdef UNDEFINED_FUNCTION
extern void defined_nowhere(void);
void calls_it(void);
void calls_it(void) {
    defined_nowhere();
}
#endif

EIGENHAND_HAND_EXPORT const eigenhand_hand_plugin_t SYMBOL = {
    MAGIC, MAJOR, MINOR, STRUCT_SIZE, GENERATE, file_count, file, error_message, release,
};
