BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('v3.2.0.a');
CREATE TABLE studies (
	study_id INTEGER NOT NULL, 
	study_name VARCHAR(512) NOT NULL, 
	PRIMARY KEY (study_id)
);
INSERT INTO "studies" VALUES(1,'grid');
INSERT INTO "studies" VALUES(2,'tpe');
CREATE TABLE study_directions (
	study_direction_id INTEGER NOT NULL, 
	direction VARCHAR(8) NOT NULL, 
	study_id INTEGER NOT NULL, 
	objective INTEGER NOT NULL, 
	PRIMARY KEY (study_direction_id), 
	UNIQUE (study_id, objective), 
	FOREIGN KEY(study_id) REFERENCES studies (study_id)
);
INSERT INTO "study_directions" VALUES(1,'MINIMIZE',1,0);
INSERT INTO "study_directions" VALUES(2,'MINIMIZE',1,1);
INSERT INTO "study_directions" VALUES(3,'MINIMIZE',2,0);
CREATE TABLE study_system_attributes (
	study_system_attribute_id INTEGER NOT NULL, 
	study_id INTEGER, 
	"key" VARCHAR(512), 
	value_json TEXT, 
	PRIMARY KEY (study_system_attribute_id), 
	UNIQUE (study_id, "key"), 
	FOREIGN KEY(study_id) REFERENCES studies (study_id)
);
INSERT INTO "study_system_attributes" VALUES(1,1,'study:metric_names','["MRE, %", "inference, ms"]');
INSERT INTO "study_system_attributes" VALUES(2,2,'study:metric_names','["MRE, %"]');
CREATE TABLE study_user_attributes (
	study_user_attribute_id INTEGER NOT NULL, 
	study_id INTEGER, 
	"key" VARCHAR(512), 
	value_json TEXT, 
	PRIMARY KEY (study_user_attribute_id), 
	UNIQUE (study_id, "key"), 
	FOREIGN KEY(study_id) REFERENCES studies (study_id)
);
INSERT INTO "study_user_attributes" VALUES(1,1,'budget','{"size": 32, "batch_size": 8, "steps": 4, "pictures": 16, "validation": 64, "calibration": 32, "alpha": 0.35, "large": "large", "weights_large": "none", "weights_small": "none"}');
INSERT INTO "study_user_attributes" VALUES(2,1,'guess_mre','72.65707641986734');
INSERT INTO "study_user_attributes" VALUES(3,1,'inference_ms small','5.652253999983259');
INSERT INTO "study_user_attributes" VALUES(4,2,'budget','{"size": 32, "batch_size": 8, "steps": 4, "pictures": 16, "validation": 64, "calibration": 32, "alpha": 0.35, "large": "large", "weights_large": "none", "weights_small": "none"}');
CREATE TABLE trial_heartbeats (
	trial_heartbeat_id INTEGER NOT NULL, 
	trial_id INTEGER NOT NULL, 
	heartbeat DATETIME NOT NULL, 
	PRIMARY KEY (trial_heartbeat_id), 
	UNIQUE (trial_id), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
INSERT INTO "trial_heartbeats" VALUES(1,1,'2026-11-28 21:39:24.000000');
INSERT INTO "trial_heartbeats" VALUES(2,2,'2026-11-28 21:39:30');
INSERT INTO "trial_heartbeats" VALUES(3,3,'2026-11-28 21:39:36');
INSERT INTO "trial_heartbeats" VALUES(4,4,'2026-11-28 21:39:36');
INSERT INTO "trial_heartbeats" VALUES(5,6,'2026-11-28 21:39:36');
INSERT INTO "trial_heartbeats" VALUES(6,7,'2026-11-28 21:39:36');
CREATE TABLE trial_intermediate_values (
	trial_intermediate_value_id INTEGER NOT NULL, 
	trial_id INTEGER NOT NULL, 
	step INTEGER NOT NULL, 
	intermediate_value FLOAT, 
	intermediate_value_type VARCHAR(7) NOT NULL, 
	PRIMARY KEY (trial_intermediate_value_id), 
	UNIQUE (trial_id, step), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
CREATE TABLE trial_params (
	param_id INTEGER NOT NULL, 
	trial_id INTEGER, 
	param_name VARCHAR(512), 
	param_value FLOAT, 
	distribution_json TEXT, 
	PRIMARY KEY (param_id), 
	UNIQUE (trial_id, param_name), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
INSERT INTO "trial_params" VALUES(1,1,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(2,1,'optimizer',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(3,1,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(4,1,'augmentation',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(5,2,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(6,2,'optimizer',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(7,2,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(8,2,'augmentation',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(9,3,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(10,3,'optimizer',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(11,3,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(12,3,'augmentation',2.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(13,4,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(14,4,'optimizer',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(15,4,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(16,4,'augmentation',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(17,5,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(18,5,'optimizer',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(19,5,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(20,5,'augmentation',2.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(21,6,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(22,6,'optimizer',4.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(23,6,'schedule',0.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(24,6,'augmentation',7.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
INSERT INTO "trial_params" VALUES(25,7,'start',1.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["large_imagenet", "small_imagenet", "large_scratch"]}}');
INSERT INTO "trial_params" VALUES(26,7,'optimizer',4.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["rmsprop", "adam", "adamw", "sgd", "nadam"]}}');
INSERT INTO "trial_params" VALUES(27,7,'schedule',3.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["piecewise", "exponential", "cosine", "linear", "constant"]}}');
INSERT INTO "trial_params" VALUES(28,7,'augmentation',8.0,'{"name": "CategoricalDistribution", "attributes": {"choices": ["none", "all", "paper", "brightness", "contrast", "hue", "saturation", "flip", "rotation90", "rotation", "gaussian", "poisson", "paper_less_brightness", "paper_less_contrast", "paper_less_hue", "paper_less_saturation", "paper_less_flip", "paper_less_rotation90", "paper_less_poisson"]}}');
CREATE TABLE trial_system_attributes (
	trial_system_attribute_id INTEGER NOT NULL, 
	trial_id INTEGER, 
	"key" VARCHAR(512), 
	value_json TEXT, 
	PRIMARY KEY (trial_system_attribute_id), 
	UNIQUE (trial_id, "key"), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
INSERT INTO "trial_system_attributes" VALUES(1,1,'artifacts:9fd76aa7-8ddf-4818-9e0b-d6477d1cd6c7','"{\"artifact_id\": \"9fd76aa7-8ddf-4818-9e0b-d6477d1cd6c7\", \"filename\": \"loss.png\", \"mimetype\": \"image/png\", \"encoding\": null}"');
INSERT INTO "trial_system_attributes" VALUES(2,1,'artifacts:652a1d55-955d-44f6-b6da-0a14eee91587','"{\"artifact_id\": \"652a1d55-955d-44f6-b6da-0a14eee91587\", \"filename\": \"worst.jpg\", \"mimetype\": \"image/jpeg\", \"encoding\": null}"');
INSERT INTO "trial_system_attributes" VALUES(3,2,'artifacts:6cd86526-ddbd-4a1f-b2e5-d1070875c2ea','"{\"artifact_id\": \"6cd86526-ddbd-4a1f-b2e5-d1070875c2ea\", \"filename\": \"loss.png\", \"mimetype\": \"image/png\", \"encoding\": null}"');
INSERT INTO "trial_system_attributes" VALUES(4,2,'artifacts:27c6a6bc-d2a7-4bb7-8f1f-aad70a001b54','"{\"artifact_id\": \"27c6a6bc-d2a7-4bb7-8f1f-aad70a001b54\", \"filename\": \"worst.jpg\", \"mimetype\": \"image/jpeg\", \"encoding\": null}"');
CREATE TABLE trial_user_attributes (
	trial_user_attribute_id INTEGER NOT NULL, 
	trial_id INTEGER, 
	"key" VARCHAR(512), 
	value_json TEXT, 
	PRIMARY KEY (trial_user_attribute_id), 
	UNIQUE (trial_id, "key"), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
INSERT INTO "trial_user_attributes" VALUES(1,1,'job','"0760"');
INSERT INTO "trial_user_attributes" VALUES(2,1,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(3,2,'job','"0761"');
INSERT INTO "trial_user_attributes" VALUES(4,2,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(5,1,'median','89.99438223122958');
INSERT INTO "trial_user_attributes" VALUES(6,1,'p90','12987.120985592213');
INSERT INTO "trial_user_attributes" VALUES(7,1,'final_loss','1.5658044815063477');
INSERT INTO "trial_user_attributes" VALUES(8,1,'validation_loss','6.347909927368164');
INSERT INTO "trial_user_attributes" VALUES(9,1,'images_per_s','57.134090528822334');
INSERT INTO "trial_user_attributes" VALUES(10,1,'parameters','182227');
INSERT INTO "trial_user_attributes" VALUES(11,1,'steps_s','0.5600859259999424');
INSERT INTO "trial_user_attributes" VALUES(12,1,'steps_cpu_s','0.4371075489999967');
INSERT INTO "trial_user_attributes" VALUES(13,1,'judging_s','0.08263072800002647');
INSERT INTO "trial_user_attributes" VALUES(14,1,'inference_ms','5.652253999983259');
INSERT INTO "trial_user_attributes" VALUES(15,1,'checkpoint','"grid-0760"');
INSERT INTO "trial_user_attributes" VALUES(16,1,'worker','"host:7472"');
INSERT INTO "trial_user_attributes" VALUES(17,1,'attempt','1');
INSERT INTO "trial_user_attributes" VALUES(18,1,'trial_s','25.344180521999988');
INSERT INTO "trial_user_attributes" VALUES(19,2,'median','68.07045258026926');
INSERT INTO "trial_user_attributes" VALUES(20,2,'p90','367.5542678313986');
INSERT INTO "trial_user_attributes" VALUES(21,2,'final_loss','1.5782398879528046');
INSERT INTO "trial_user_attributes" VALUES(22,2,'validation_loss','1.5647528171539307');
INSERT INTO "trial_user_attributes" VALUES(23,2,'images_per_s','47.49248600971646');
INSERT INTO "trial_user_attributes" VALUES(24,2,'parameters','182227');
INSERT INTO "trial_user_attributes" VALUES(25,2,'steps_s','0.6737907970000379');
INSERT INTO "trial_user_attributes" VALUES(26,2,'steps_cpu_s','0.4672650030000014');
INSERT INTO "trial_user_attributes" VALUES(27,2,'judging_s','0.11408716599999025');
INSERT INTO "trial_user_attributes" VALUES(28,2,'inference_ms','5.652253999983259');
INSERT INTO "trial_user_attributes" VALUES(29,2,'checkpoint','"grid-0761"');
INSERT INTO "trial_user_attributes" VALUES(30,2,'worker','"host:7472"');
INSERT INTO "trial_user_attributes" VALUES(31,2,'attempt','1');
INSERT INTO "trial_user_attributes" VALUES(32,2,'trial_s','1.5771386050000729');
INSERT INTO "trial_user_attributes" VALUES(33,3,'job','"0762"');
INSERT INTO "trial_user_attributes" VALUES(34,3,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(35,4,'job','"0763"');
INSERT INTO "trial_user_attributes" VALUES(36,4,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(37,3,'reason','"training diverged: nan at step 1"');
INSERT INTO "trial_user_attributes" VALUES(38,5,'job','"0762"');
INSERT INTO "trial_user_attributes" VALUES(39,5,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(40,6,'job','"0000"');
INSERT INTO "trial_user_attributes" VALUES(41,6,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(42,6,'inference_ms','1.5');
INSERT INTO "trial_user_attributes" VALUES(43,7,'job','"0001"');
INSERT INTO "trial_user_attributes" VALUES(44,7,'seed','0');
INSERT INTO "trial_user_attributes" VALUES(45,7,'inference_ms','1.5');
CREATE TABLE trial_values (
	trial_value_id INTEGER NOT NULL, 
	trial_id INTEGER NOT NULL, 
	objective INTEGER NOT NULL, 
	value FLOAT, 
	value_type VARCHAR(7) NOT NULL, 
	PRIMARY KEY (trial_value_id), 
	UNIQUE (trial_id, objective), 
	FOREIGN KEY(trial_id) REFERENCES trials (trial_id)
);
INSERT INTO "trial_values" VALUES(1,1,0,7.13904222906026698176e+04,'FINITE');
INSERT INTO "trial_values" VALUES(2,1,1,5.65225399998325883643e+00,'FINITE');
INSERT INTO "trial_values" VALUES(3,2,0,1.92221396519744814664e+02,'FINITE');
INSERT INTO "trial_values" VALUES(4,2,1,5.65225399998325883643e+00,'FINITE');
INSERT INTO "trial_values" VALUES(5,6,0,80.0,'FINITE');
INSERT INTO "trial_values" VALUES(6,7,0,60.0,'FINITE');
CREATE TABLE trials (
	trial_id INTEGER NOT NULL, 
	number INTEGER, 
	study_id INTEGER, 
	state VARCHAR(8) NOT NULL, 
	datetime_start DATETIME, 
	datetime_complete DATETIME, 
	PRIMARY KEY (trial_id), 
	FOREIGN KEY(study_id) REFERENCES studies (study_id)
);
INSERT INTO "trials" VALUES(1,0,1,'COMPLETE','2026-11-28 21:39:04.829475','2026-11-28 21:39:30.217929');
INSERT INTO "trials" VALUES(2,1,1,'COMPLETE','2026-11-28 21:39:30.224310','2026-11-28 21:39:31.843253');
INSERT INTO "trials" VALUES(3,2,1,'FAIL','2026-11-28 21:39:36.349094','2026-11-28 21:39:36.357163');
INSERT INTO "trials" VALUES(4,3,1,'RUNNING','2026-11-28 21:39:36.413328',NULL);
INSERT INTO "trials" VALUES(5,4,1,'WAITING',NULL,NULL);
INSERT INTO "trials" VALUES(6,0,2,'COMPLETE','2026-11-28 21:39:36.567424','2026-11-28 21:39:36.653376');
INSERT INTO "trials" VALUES(7,1,2,'COMPLETE','2026-11-28 21:39:36.684369','2026-11-28 21:39:36.753225');
CREATE TABLE version_info (
	version_info_id INTEGER NOT NULL, 
	schema_version INTEGER, 
	library_version VARCHAR(256), 
	PRIMARY KEY (version_info_id), 
	CHECK (version_info_id=1)
);
INSERT INTO "version_info" VALUES(1,12,'5.0.0');
CREATE UNIQUE INDEX ix_studies_study_name ON studies (study_name);
CREATE INDEX ix_trials_study_id ON trials (study_id);
COMMIT;